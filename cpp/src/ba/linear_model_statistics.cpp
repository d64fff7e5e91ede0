// The inverse of the normal equations and what follows from it (ba/linear_model.hpp).
#include <algorithm>
#include <numeric>

#include "linear_model_work.hpp"
#include "sfmcpp/core/error.hpp"

namespace sfmcpp::ba {
namespace {

// A variance this many times that of the parameter with all others held is rounding: nothing
// determines the parameter.
constexpr double kLargestInflation = 1e13;
// Far above rounding, and so little that what it alone determines is told apart.
constexpr double kNamingDamping = 1e-12;

// out += the rows of a camera block that have a column (Pᵀ y); and back (P x).
void fold(const linear::ParameterMap& map,
          int camera,
          const MatrixXd& block,
          Eigen::Ref<MatrixXd> out) {
  for_each_column(map, camera, [&](int k, int column) { out.row(column) += block.row(k); });
}

MatrixXd expanded(const linear::ParameterMap& map, int camera, const MatrixXd& x) {
  MatrixXd block = MatrixXd::Zero(map.camera_size, x.cols());
  for_each_column(map, camera, [&](int k, int column) { block.row(k) = x.row(column); });
  return block;
}

void require_in_range(const char* name, int value, int end) {
  if (value >= 0 && value < end) return;
  throw InvalidArgument(std::string(name) + ": " + std::to_string(value) + ", must be in [0, " +
                        std::to_string(end) + ")");
}

// The columns of a block that there are, and where they stand in it.
struct Chosen {
  std::vector<int> columns, places;
};

Chosen chosen_of(std::span<const int> block) {
  Chosen chosen;
  for (int k = 0; k < static_cast<int>(block.size()); ++k) {
    if (block[k] < 0) continue;
    chosen.columns.push_back(block[k]);
    chosen.places.push_back(k);
  }
  return chosen;
}

}  // namespace

void LinearModel::factorize() {
  if (work_->solver) return;
  if (!is_metric(problem_.camera_model)) {
    throw InvalidArgument(
        "camera_model = 'projective': its gauge of 15 degrees of freedom is left to damping, so "
        "that its normal equations have no inverse; covariances and what follows from them are for "
        "metric models");
  }
  Workspace& space = work_->space;
  auto kind = linear::choose_linear_solver({.graph = space.rows.graph(),
                                            .map = space.map,
                                            .pool = space.pool,
                                            .pairs = work_->normal().camera_terms().pairs(),
                                            .exchange = space.exchange},
                                           {})
                  .kind;
  if (kind != linear::LinearSolverKind::kDense) kind = linear::LinearSolverKind::kSparse;
  auto solver = std::make_unique<linear::ExplicitSchurSolver>(work_->normal(), kind);
  const auto factorizes = [&](double damping) {
    return solver->solve({.lambda = damping}, step_, [] { return false; }).success;
  };
  const bool is_regular = factorizes(ridge_);
  // Rounding decides whether what nothing tells is singular: with a little damping it has a name.
  const bool may_have_name = has_free_sensors() && (is_regular || factorizes(kNamingDamping));
  work_->solver = std::move(solver);
  try {
    if (may_have_name) require_sensors();
    if (!is_regular) {
      throw InvalidArgument(
          "problem: its normal equations are singular: observations and constraints do not "
          "determine all free parameters of the cameras; fix some or add observations");
    }
    find_unseen();
  } catch (...) {
    work_->solver.reset();  // refused again when asked again
    throw;
  }
}

// Rows by columns as they are called outside; zero where held.
MatrixXd LinearModel::assembled(const MatrixXd& camera, const MatrixXd& point) const {
  MatrixXd all = MatrixXd::Zero(num_columns(), camera.cols());
  for (std::size_t c = 0; c < inner_.size(); ++c) {
    if (inner_[c] != kNoColumn) all.row(static_cast<Index>(c)) = camera.row(inner_[c]);
  }
  for (std::size_t k = 0; k < points_.size(); ++k)
    all.middleRows<3>(map_.num_columns + 3 * static_cast<Index>(k)) =
        point.middleRows<3>(3L * points_[k]);
  return all;
}

// H x = b in the fixed gauge by elimination of the points, for every column; b before, x after.
void LinearModel::solve_all(MatrixXd& camera, MatrixXd& point) {
  const linear::ParameterMap& inside = work_->space.map;
  const linear::ObservationGraph& graph = work_->graph();
  for (int p : points_) {
    const MatrixXd alone = work_->point_inverse(p) * point.middleRows<3>(3L * p);
    work_->for_each_view(p, [&](int a) {
      fold(inside,
           graph.camera[a],
           -work_->by_camera(a).transpose() * (work_->by_point(a) * alone),
           camera);
    });
  }
  work_->solver->solve_reduced(camera);
  for (int p : points_) {
    work_->for_each_view(p, [&](int a) {
      point.middleRows<3>(3L * p) -=
          work_->by_point(a).transpose() *
          (work_->by_camera(a) * expanded(inside, graph.camera[a], camera));
    });
    point.middleRows<3>(3L * p) = (work_->point_inverse(p) * point.middleRows<3>(3L * p)).eval();
  }
}

int LinearModel::num_determined() {
  factorize();
  return std::accumulate(
      points_.begin(), points_.end(), work_->space.map.num_columns, [&](int sum, int p) {
        return sum + work_->point_rank(p);
      });
}

double LinearModel::log_determinant() {
  factorize();
  return work_->solver->log_determinant();
}

// Columns of the reduced system that stand for columns of H: those of cameras for themselves, those
// of points with what they pull at the cameras.
LinearModel::SparseColumns LinearModel::reduced(std::span<const int> columns) const {
  std::vector<Entry> entries;
  const linear::ParameterMap& inside = work_->space.map;
  for (int k = 0; k < static_cast<int>(columns.size()); ++k) {
    if (columns[k] < map_.num_columns) {
      if (inner_[columns[k]] != kNoColumn) entries.emplace_back(inner_[columns[k]], k, 1.0);
      continue;
    }
    const int p = points_[(columns[k] - map_.num_columns) / 3];
    const Eigen::Vector3d alone = work_->point_inverse(p).col((columns[k] - map_.num_columns) % 3);
    work_->for_each_view(p, [&](int a) {
      const VectorXd pull = work_->by_camera(a).transpose() * (work_->by_point(a) * alone);
      for_each_column(inside, work_->graph().camera[a], [&](int row, int column) {
        entries.emplace_back(column, k, -pull[row]);
      });
    });
  }
  SparseColumns result(inside.num_columns, static_cast<Index>(columns.size()));
  result.setFromTriplets(entries.begin(), entries.end());
  return result;
}

const MatrixXd& LinearModel::inverse() {
  factorize();
  const int size = work_->space.map.num_columns;
  if (inverse_.rows() == size) return inverse_;
  if (size > kMaxInverse) {
    throw InvalidArgument("problem: " + std::to_string(size) +
                          " free parameters of cameras, must be at most " +
                          std::to_string(kMaxInverse) + " for leverages");
  }
  inverse_.setIdentity(size, size);
  work_->solver->solve_reduced(inverse_);
  inverse_ = (0.5 * (inverse_ + inverse_.transpose())).eval();
  return inverse_;
}

// By the factor, though the inverse may be there: the same bits whatever was asked before.
MatrixXd LinearModel::solve(const SparseColumns& rhs) const {
  MatrixXd x = rhs;
  work_->solver->solve_reduced(x);
  return x;
}

MatrixXd LinearModel::covariance(std::span<const int> columns) {
  factorize();
  for (int column : columns) require_in_range("columns", column, num_columns());
  const SparseColumns rhs = reduced(columns);
  MatrixXd result = rhs.transpose() * solve(rhs);
  add_points(columns, result);
  require_determined(columns, result);
  return in_the_gauge(columns, result);
}

// What points have of themselves, with all cameras held.
void LinearModel::add_points(std::span<const int> columns, MatrixXd& result) const {
  const auto count = static_cast<Index>(columns.size());
  for (Index a = 0; a < count; ++a) {
    for (Index b = 0; b < count; ++b) {
      const int i = columns[a] - map_.num_columns, j = columns[b] - map_.num_columns;
      if (i >= 0 && j >= 0 && i / 3 == j / 3)
        result(a, b) += work_->point_inverse(points_[i / 3])(i % 3, j % 3);
    }
  }
}

// Of columns with that covariance in the fixed gauge.
MatrixXd LinearModel::in_the_gauge(std::span<const int> columns, MatrixXd covariance) const {
  if (unseen_.size() > 0) {
    const auto count = static_cast<Index>(columns.size());
    MatrixXd n(count, unseen_.cols()), of_n(count, unseen_.cols());
    for (Index k = 0; k < count; ++k) {
      n.row(k) = unseen_.row(columns[k]);
      of_n.row(k) = of_unseen_.row(columns[k]);
    }
    covariance += n * among_unseen_ * n.transpose() - of_n * n.transpose() - n * of_n.transpose();
  }
  return 0.5 * (covariance + covariance.transpose());
}

void LinearModel::require_determined(std::span<const int> columns,
                                     const MatrixXd& covariance) const {
  for (std::size_t k = 0; k < columns.size(); ++k) {
    const int c = columns[k];
    const bool of_point = c >= map_.num_columns;
    const int p = of_point ? points_[(c - map_.num_columns) / 3] : -1;
    const auto place = static_cast<Index>(k);
    const double alone = of_point
                             ? work_->normal().point_block(p).diagonal()[(c - map_.num_columns) % 3]
                         : inner_[c] == kNoColumn ? 0.0
                                                  : work_->normal().camera_diagonal()[inner_[c]];
    const bool lost = of_point && work_->point_rank(p) < 3;
    if (!lost && covariance(place, place) * alone <= kLargestInflation) continue;
    throw InvalidArgument(of_point
                              ? "point " + std::to_string(p) +
                                    ": its position is not determined by its observations, it has "
                                    "no covariance"
                              : "column " + std::to_string(c) +
                                    " of a camera: not determined by observations and "
                                    "constraints, it has no covariance");
  }
}

void LinearModel::covariance_blocks(std::span<const int> columns, int width, double* out) {
  if (width < 1 || columns.size() % static_cast<std::size_t>(width) != 0)
    throw InvalidArgument("width = " + std::to_string(width) + ": " +
                          std::to_string(columns.size()) + " columns are no blocks of that width");
  factorize();
  for (int column : columns) require_in_range("columns", std::max(column, 0), num_columns());
  // A column of the inverse is a solve, one of the blocks half a solve at most.
  const int size = work_->space.map.num_columns;
  const bool by_inverse = size <= kMaxInverse && columns.size() > 2UL * size;
  if (by_inverse) inverse();
  const auto count = static_cast<int>(columns.size()) / width;
  std::vector<MatrixXd> found(static_cast<std::size_t>(count));
  const auto chosen = [&](int k) { return chosen_of(columns.subspan(width * k, width)); };
  work_->space.pool.parallel_for_worker(count, [&](int k, int worker) {
    const SparseColumns rhs = reduced(chosen(k).columns);
    found[k] = by_inverse ? MatrixXd(rhs.transpose() * MatrixXd(inverse_ * rhs))
                          : work_->solver->inverse_product(rhs, worker);
    add_points(chosen(k).columns, found[k]);
  });
  for (int k = 0; k < count; ++k) {
    const Chosen block = chosen(k);
    require_determined(block.columns, found[k]);
    Eigen::Map<MatrixXd> of_block(out + Index{width} * width * k, width, width);
    of_block.setZero();
    of_block(block.places, block.places) = in_the_gauge(block.columns, found[k]);
  }
}

void LinearModel::leverages(double* out) {
  const MatrixXd& cameras = inverse();
  const linear::ParameterMap& inside = work_->space.map;
  const linear::ObservationGraph& graph = work_->graph();
  const Index size = work_->size();
  // Fixed points too: their observations still draw the cameras.
  linear::for_each_point(work_->space.pool, num_points(), [&](int p) {
    const Index views = graph.observations_of_point(p);
    const bool free = point_place_[p] >= 0;
    const Matrix3d alone = free ? work_->point_inverse(p) : Matrix3d(Matrix3d::Zero());
    std::vector<int> columns;
    MatrixXd pull(views * size, 3);  // Jᵀ A V⁻¹ of the views
    work_->for_each_view(p, [&](int a) {
      pull.middleRows(static_cast<Index>(columns.size()), size) =
          work_->by_camera(a).transpose() * (work_->by_point(a) * alone);
      columns.insert(columns.end(),
                     inside.columns_of(graph.camera[a]),
                     inside.columns_of(graph.camera[a]) + size);
    });
    const auto entry = [&](Index r, Index c) {
      return columns[r] == kNoColumn || columns[c] == kNoColumn ? 0.0
                                                                : cameras(columns[r], columns[c]);
    };
    const Index rows = views * size;
    const MatrixXd among = MatrixXd::NullaryExpr(rows, rows, entry);
    const MatrixXd with_point = among * pull;
    const Matrix3d of_point = alone + pull.transpose() * with_point;
    Index first = 0;
    work_->for_each_view(p, [&](int a) {
      if (a >= num_observations()) return;  // images come first
      const RowsByCamera j = work_->by_camera(a);
      const RowsByPoint by_point = work_->by_point(a);
      const Eigen::Matrix2d cross = j * with_point.middleRows(first, size) * by_point.transpose();
      Eigen::Map<Eigen::Matrix2d>(out + 4L * graph.source[a]) =
          j * among.block(first, first, size, size) * j.transpose() +
          by_point * of_point * by_point.transpose() - cross - cross.transpose();
      first += size;
    });
  });
}

const MatrixXd& LinearModel::hat(int g) {
  require_in_range("group", g, static_cast<int>(groups_.size()));
  factorize();
  hats_.resize(groups_.size());
  MatrixXd& known = hats_[static_cast<std::size_t>(g)];
  if (known.size() > 0) return known;
  const ConstraintRows& group = groups_[static_cast<std::size_t>(g)];
  known = group.jacobian.cols() > map_.num_columns ? hat_with_points(group) : hat_of_cameras(group);
  return known;
}

MatrixXd LinearModel::hat_with_points(const ConstraintRows& group) {
  const MatrixXd dense = group.jacobian.toDense();
  std::vector<int> columns;
  for (int c = 0; c < num_columns(); ++c) {
    if (dense.col(c).any()) columns.push_back(c);
  }
  MatrixXd rows(dense.rows(), static_cast<Eigen::Index>(columns.size()));
  for (std::size_t k = 0; k < columns.size(); ++k) {
    rows.col(static_cast<Eigen::Index>(k)) = dense.col(columns[k]);
  }
  return group.weight * (rows * covariance(columns) * rows.transpose());
}

MatrixXd LinearModel::hat_of_cameras(const ConstraintRows& group) {
  std::vector<Entry> entries;
  for (int row = 0; row < group.jacobian.outerSize(); ++row) {
    for (decltype(group.jacobian)::InnerIterator e(group.jacobian, row); e; ++e) {
      if (inner_[e.col()] != kNoColumn) entries.emplace_back(inner_[e.col()], row, e.value());
    }
  }
  SparseColumns rows(work_->space.map.num_columns, group.jacobian.rows());
  rows.setFromTriplets(entries.begin(), entries.end());
  const MatrixXd result = group.weight * (rows.transpose() * solve(rows));
  return 0.5 * (result + result.transpose());
}

Spectrum LinearModel::hat_spectrum(int group) { return symmetric_spectrum(hat(group)); }

}  // namespace sfmcpp::ba
