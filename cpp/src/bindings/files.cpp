// What files hold: numbers as text, records, and lists in groups.
#include <limits>

#include <pybind11/stl.h>

#include "arrays.hpp"
#include "module.hpp"
#include "python_function.hpp"
#include "sfmcpp/core/grouping.hpp"
#include "sfmcpp/core/number_text.hpp"
#include "sfmcpp/core/records.hpp"

namespace sfmcpp::bindings {
namespace {

using Bytes = py::array_t<std::uint8_t, py::array::c_style>;
using Indices = py::array_t<std::int32_t, py::array::c_style>;
using Column = std::pair<std::string, py::array>;

constexpr long kBytesOfAThread = 1 << 17, kRowsOfAThread = 1 << 12;

int threads_for(int requested, long work, long work_of_a_thread) {
  if (requested > 0) return requested;
  const long machine = resolve_num_threads(0, std::numeric_limits<long>::max());
  return static_cast<int>(std::max(std::min(machine, work / work_of_a_thread), 1L));
}

// Bytes, or an array of them; while the buffer lives, nobody frees or resizes it.
class TextBuffer {
 public:
  explicit TextBuffer(const py::buffer& text) : info_(text.request()) {
    if (info_.ndim != 1 || info_.itemsize != 1 || info_.strides[0] != 1)
      throw InvalidArgument("text: must be bytes one after another");
  }
  std::string_view text() const {
    return {static_cast<const char*>(info_.ptr), static_cast<std::size_t>(info_.size)};
  }

 private:
  py::buffer_info info_;
};

py::array_t<std::uint8_t> text_memory(long bytes) {
  if (bytes < 0) throw InvalidArgument("bytes = " + std::to_string(bytes) + ": must be at least 0");
  return array_from(AlignedVector<std::uint8_t>(static_cast<std::size_t>(bytes)));
}

std::string_view bytes_of(const Bytes& array) {
  return {reinterpret_cast<const char*>(array.data()), static_cast<std::size_t>(array.size())};
}

py::tuple read_numbers(const py::buffer& data, bool comments, int threads) {
  const TextBuffer buffer(data);
  const std::string_view text = buffer.text();
  const auto bytes = static_cast<long>(text.size());
  const BorrowedPool borrowed(threads_for(threads, bytes, kBytesOfAThread));
  const NumberText numbers = [&] {
    const ReleasedGil released;
    return NumberText(text, comments, *borrowed);
  }();
  AlignedVector<double> values(static_cast<std::size_t>(numbers.size()));
  const long bad = [&] {
    const ReleasedGil released;
    return numbers.read(values.data(), *borrowed);
  }();
  return py::make_tuple(array_from(std::move(values)), bad);
}

py::tuple number_lines(const py::buffer& data, bool comments, int threads) {
  const TextBuffer buffer(data);
  const std::string_view text = buffer.text();
  const BorrowedPool borrowed(
      threads_for(threads, static_cast<long>(text.size()), kBytesOfAThread));
  const NumberText::Lines lines = [&] {
    const ReleasedGil released;
    return NumberText(text, comments, *borrowed).lines(*borrowed);
  }();
  return py::make_tuple(array_of(lines.first), array_of(lines.count), array_of(lines.number));
}

TextColumn text_column(const Column& column, py::ssize_t rows) {
  const py::array& values = column.second;
  if (values.ndim() != 1 || values.shape(0) < rows || !(values.flags() & py::array::c_style)) {
    throw InvalidArgument("columns: must be contiguous, of one dimension, and as long as the rows");
  }
  TextColumn result{column.first, {}};
  if (py::isinstance<py::array_t<double>>(values)) {
    result.values = static_cast<const double*>(values.data());
  } else if (py::isinstance<py::array_t<long>>(values)) {
    result.values = static_cast<const long*>(values.data());
  } else if (values.dtype().kind() == 'S') {
    result.values = FixedTexts{static_cast<const char*>(values.data()), values.itemsize()};
  } else {
    throw InvalidArgument("columns: must be of float64, int64 or bytes");
  }
  return result;
}

TextRow text_row(const std::vector<Column>& columns, const std::string& after, py::ssize_t rows) {
  TextRow row{{}, after};
  for (const Column& column : columns) row.columns.push_back(text_column(column, rows));
  return row;
}

py::bytes joined(const std::vector<std::string>& texts) {
  std::size_t size = 0;
  for (const std::string& text : texts) size += text.size();
  PyObject* bytes = PyBytes_FromStringAndSize(nullptr, static_cast<Py_ssize_t>(size));
  if (bytes == nullptr) throw py::error_already_set();
  char* out = PyBytes_AS_STRING(bytes);
  for (const std::string& text : texts) out = std::copy(text.begin(), text.end(), out);
  return py::reinterpret_steal<py::bytes>(bytes);
}

py::bytes ragged_text(const std::vector<Column>& head,
                      const std::string& after_head,
                      const std::vector<Column>& item,
                      const std::string& after_item,
                      const std::string& tail,
                      const py::array_t<long, py::array::c_style>& counts,
                      int threads) {
  const KeptArrays kept(head, item, counts);
  const std::span<const long> of_heads(counts.data(), static_cast<std::size_t>(counts.size()));
  long items = 0;
  for (const long count : of_heads) {
    if (count < 0) throw InvalidArgument("counts: must not be negative");
    items += count;
  }
  const TextRow heads = text_row(head, after_head, counts.size());
  const TextRow rows = text_row(item, after_item, items);
  const BorrowedPool borrowed(threads_for(threads, counts.size() + items, kRowsOfAThread));
  const std::vector<std::string> texts = [&] {
    const ReleasedGil released;
    return ragged_rows(heads, rows, tail, of_heads, *borrowed);
  }();
  return joined(texts);
}

RecordLayout layout_of(long head, long item) {
  if (head < kCountBytes)
    throw InvalidArgument("head = " + std::to_string(head) + ": must be at least " +
                          std::to_string(kCountBytes) + " bytes, those of its count");
  if (item < 1)
    throw InvalidArgument("item = " + std::to_string(item) + ": must be at least 1 byte");
  return {head, item};
}

py::tuple split_records_of(const py::bytes& data, long begin, long count, long head, long item) {
  const std::string_view bytes = static_cast<std::string_view>(data).substr(begin);
  const RecordLayout layout = layout_of(head, item);
  const Records records = find_records(bytes, count, layout);
  const auto heads_size = static_cast<long>(records.begin.size()) * head;
  py::array_t<std::uint8_t> heads(heads_size), items(records.end - heads_size);
  split_records(bytes,
                records,
                layout,
                reinterpret_cast<char*>(heads.mutable_data()),
                reinterpret_cast<char*>(items.mutable_data()));
  return py::make_tuple(std::move(heads), std::move(items), begin + records.end);
}

py::array_t<std::uint8_t> join_records_of(const Bytes& heads,
                                          const Bytes& items,
                                          long head,
                                          long item) {
  const std::string_view head_bytes = bytes_of(heads), item_bytes = bytes_of(items);
  const RecordLayout layout = layout_of(head, item);
  if (!counts_fit(head_bytes, item_bytes, layout)) {
    throw InvalidArgument("items: must be as many as the heads count");
  }
  py::array_t<std::uint8_t> data(static_cast<py::ssize_t>(head_bytes.size() + item_bytes.size()));
  join_records(head_bytes, item_bytes, layout, reinterpret_cast<char*>(data.mutable_data()));
  return data;
}

py::array_t<long> group_ranks_of(const Indices& group, long num_groups) {
  py::array_t<long> ranks(group.size());
  const std::span<const std::int32_t> groups(group.data(), static_cast<std::size_t>(group.size()));
  if (num_groups < 0 || !group_ranks(groups, num_groups, ranks.mutable_data())) {
    throw InvalidArgument("group: must be from 0 to " + std::to_string(num_groups - 1));
  }
  return ranks;
}

}  // namespace

void bind_files(py::module_& m) {
  m.def("text_memory",
        &text_memory,
        py::arg("bytes"),
        "Memory for so many bytes of text, not set; the next solve finds its pages again.");
  m.def("read_numbers",
        &read_numbers,
        py::arg("text"),
        py::arg("comments") = false,
        py::arg("threads") = 0,
        "All numbers of a text, and the byte of the first word that is no finite number, or -1.");
  m.def("number_lines",
        &number_lines,
        py::arg("text"),
        py::arg("comments") = false,
        py::arg("threads") = 0,
        "Lines that hold words: index of the first word, how many, number of the line from 1.");
  m.def("ragged_text",
        &ragged_text,
        py::arg("head"),
        py::arg("after_head"),
        py::arg("item"),
        py::arg("after_item"),
        py::arg("tail"),
        py::arg("counts"),
        py::arg("threads") = 0,
        "Rows of text: each head, then the next counts[i] items, then the tail. A column is a pair "
        "of the text before it and its values.");
  m.def("split_records",
        &split_records_of,
        py::arg("data"),
        py::arg("begin"),
        py::arg("count"),
        py::arg("head_bytes"),
        py::arg("item_bytes"),
        "Heads and items of the records from byte `begin` on, and where the last one ends that "
        "fits.");
  m.def("join_records",
        &join_records_of,
        py::arg("heads").noconvert(),
        py::arg("items").noconvert(),
        py::arg("head_bytes"),
        py::arg("item_bytes"),
        "The bytes that split_records takes apart.");
  m.def("group_ranks",
        &group_ranks_of,
        py::arg("group").noconvert(),
        py::arg("num_groups"),
        "How many elements of the same group come before each one.");
}

}  // namespace sfmcpp::bindings
