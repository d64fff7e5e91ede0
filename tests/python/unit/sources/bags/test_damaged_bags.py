"""Damaged and hostile bags are refused in one line, with nothing half-written, blocked, run or filled up."""

from __future__ import annotations

import os
import random
import shutil
import sqlite3
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode

from bag_writing import START_NS, messages_for, write_bag
from sfmcpp import DatasetError
from sfmcpp.sources.bags import open_bag, unpack_bag

BZ2, LZ4 = ((way,) for way in (Writer1.CompressionFormat.BZ2, Writer1.CompressionFormat.LZ4))
FILES, MESSAGES, CHUNKS = (
    (mode, CompressionFormat.ZSTD)
    for mode in (CompressionMode.FILE, CompressionMode.MESSAGE, CompressionMode.STORAGE)
)
WAYS = {
    "plain.bag": None,
    "bz2.bag": BZ2,
    "lz4.bag": LZ4,
    "plain.db3": None,
    "file.db3": FILES,
    "message.db3": MESSAGES,
    "plain.mcap": None,
    "chunk.mcap": CHUNKS,
}
COMPRESSED = [name for name, way in WAYS.items() if way is not None]
CHANGES = 12


def write(folder: Path, name: str, side: int = 16) -> Path:
    made = messages_for(name.rpartition(".")[2])
    recorded: list[Any] = [("/imu", made.imu(START_NS + k, (0, 0, k / 1000))) for k in range(0, 4000, 1000)]
    recorded += [("/image", made.image(START_NS, np.zeros((side, side))))]
    return write_bag(folder / name, made, recorded, compression=WAYS[name])


def data_file(path: Path) -> Path:
    return path if path.is_file() else next(f for f in path.iterdir() if f.name != "metadata.yaml")


def require_refused(path: Path, told: str = "") -> None:
    out = path.with_name("out")
    with pytest.raises(DatasetError) as caught:
        unpack_bag(path, out)
    assert told in caught.value.reason
    assert "\n" not in str(caught.value)
    assert sorted(f.name for f in path.parent.iterdir()) == [path.name]


@pytest.mark.parametrize("name", WAYS)
def test_what_is_whole_is_read(tmp_path: Path, name: str) -> None:
    result = unpack_bag(write(tmp_path, name), tmp_path / "out")
    assert result.counts == {"images": 1, "imu": 4}


@pytest.mark.parametrize("column", ["name", "type"])
def test_a_topic_whose_name_or_type_is_no_text_is_refused(tmp_path: Path, column: str) -> None:
    path = tmp_path / "one" / "file.db3"
    path.parent.mkdir()
    shutil.copyfile(data_file(write(tmp_path, "plain.db3")), path)
    with closing(sqlite3.connect(path)) as base, base:
        base.execute(f"UPDATE topics SET {column} = x'41' WHERE id = 1")
    require_refused(path, "is damaged, or no bag")


@pytest.mark.parametrize("name", WAYS)
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9])
def test_a_bag_that_was_cut_short_is_refused(tmp_path: Path, name: str, share: float) -> None:
    path = write(tmp_path, name)
    file = data_file(path)
    os.truncate(file, int(share * file.stat().st_size))
    require_refused(path)


@pytest.mark.parametrize("name", WAYS)
def test_changed_bytes_are_refused_or_harmless(tmp_path: Path, name: str) -> None:
    whole = write(tmp_path, name)
    content, chance = data_file(whole).read_bytes(), random.Random(name)
    for _ in range(CHANGES):
        changed = bytearray(content)
        place = chance.randrange(len(changed) - 8)
        changed[place : place + 8] = chance.choice([b"\xff" * 8, bytes(8), chance.randbytes(8)])
        data_file(whole).write_bytes(changed)
        reason = _reason_to_refuse(whole, tmp_path / "out")
        assert "\n" not in reason
        assert (tmp_path / "out").exists() == (reason == "")
        shutil.rmtree(tmp_path / "out", ignore_errors=True)


def _reason_to_refuse(path: Path, out: Path) -> str:
    try:
        unpack_bag(path, out)
    except DatasetError as error:
        return str(error)
    return ""


def test_of_two_bags_open_at_once_the_one_that_is_left_is_still_bounded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, last = write(tmp_path, "lz4.bag"), write(tmp_path, "message.db3", side=1500)
    one = open_bag(first)
    one.__enter__()
    with open_bag(last) as other:
        one.__exit__(None, None, None)
        monkeypatch.setenv("SFMCPP_MAX_EXPANDED_MB", "1")
        with pytest.raises(DatasetError, match="SFMCPP_MAX_EXPANDED_MB"):
            list(other.messages(["/image"]))


@pytest.mark.parametrize("name", COMPRESSED)
def test_no_compressed_data_expand_without_limit(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path, name, side=1500)
    assert data_file(path).stat().st_size < 100_000
    monkeypatch.setenv("SFMCPP_MAX_EXPANDED_MB", "1")
    require_refused(path, "SFMCPP_MAX_EXPANDED_MB")
    monkeypatch.setenv("SFMCPP_MAX_EXPANDED_MB", "4")
    assert unpack_bag(path, tmp_path / "out").counts["images"] == 1


def test_the_library_is_left_as_it_was(tmp_path: Path) -> None:
    from rosbags.rosbag1 import reader as reader1
    from rosbags.rosbag2 import reader as reader2
    from rosbags.rosbag2 import storage_mcap

    tables = (reader1.decompressors, storage_mcap.DECOMPRESSORS, vars(reader2))
    before = [dict(table) for table in tables]
    unpack_bag(write(tmp_path, "lz4.bag"), tmp_path / "out")
    assert [dict(table) for table in tables] == before
    one, other = open_bag(tmp_path / "lz4.bag"), open_bag(write(tmp_path, "plain.db3"))
    for step in (one.__enter__, other.__enter__):
        step()
    for bag in (one, other):
        bag.__exit__(None, None, None)
    assert [dict(table) for table in tables] == before


@pytest.mark.parametrize("name", ["plain.bag", "plain.mcap"])
def test_messages_by_another_definition_are_refused(tmp_path: Path, name: str) -> None:
    path = write(tmp_path, name)
    with open_bag(path) as bag:
        digests = {known.msgtype: known.digest for known in bag._reader.connections}
    for file in [path] if path.is_file() else path.iterdir():
        digest = digests["sensor_msgs/msg/Imu"].encode()
        file.write_bytes(file.read_bytes().replace(digest, digest[:-4] + b"0000"))
    require_refused(path, "/imu has messages by another definition of sensor_msgs/msg/Imu")


def test_definitions_that_a_bag_brings_along_are_not_run(tmp_path: Path) -> None:
    path = write(tmp_path, "plain.bag")
    content = path.read_bytes()
    definition = content[(start := content.index(b"message_definition=")) :][:400]
    hostile = (b"message_definition=\nimport sys; sys.exit(1)\n" + b"#" * 400)[: len(definition)]
    path.write_bytes(content[:start] + hostile + content[start + len(hostile) :])
    assert unpack_bag(path, tmp_path / "out").counts["imu"] == 4


def test_metadata_that_explode_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path, "plain.db3")
    metadata = path / "metadata.yaml"
    lines = ["a0: &a0 [x, x]", *(f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}]" for k in range(1, 40))]
    text = metadata.read_text().replace("compression_format: ''", "compression_format: *a39")
    metadata.write_text("\n".join([*lines, text]))
    require_refused(path, "anchors")
    metadata.write_text("#" * (5 << 20))
    require_refused(path, "holds more than")


@pytest.mark.parametrize("name", ["plain.db3", "plain.mcap"])
def test_metadata_are_not_parsed_in_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr("ruamel.yaml.YAML.load", lambda *_: pytest.fail("a megabyte takes half a minute"))
    path = write(tmp_path, name)
    text = (path / "metadata.yaml").read_text()
    assert "offered_qos_profiles" in text
    with open_bag(path) as bag:
        assert {topic.name: topic.count for topic in bag.topics} == {"/image": 1, "/imu": 4}
    (path / "metadata.yaml").write_text(text.replace("message_count: 4", f"message_count: {'1:' * 999}1"))
    require_refused(path, "invalid literal")


ENDLESS = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT max(x) FROM n"


@pytest.mark.parametrize("alone", [False, True])
@pytest.mark.parametrize(
    ("statement", "told"),
    [
        (f"DROP TABLE schema; CREATE VIEW schema(schema_version) AS {ENDLESS}", "schema is a view"),
        ("ALTER TABLE topics ADD COLUMN more AS (zeroblob(900000000))", "table topics has columns that are"),
    ],
)
def test_formulas_that_a_database_brings_along_are_not_run(
    tmp_path: Path, statement: str, told: str, alone: bool
) -> None:
    path = write(tmp_path, "plain.db3")
    if alone:
        path = data_file(path).replace(tmp_path / "alone.db3")
        shutil.rmtree(tmp_path / "plain.db3")
    with closing(sqlite3.connect(path if alone else data_file(path))) as tables:
        tables.executescript(statement)
    require_refused(path, told)


@pytest.mark.parametrize("folder", ["drive #3", "50%20", "what?", "\udcff"])
def test_a_database_is_read_wherever_it_lies(tmp_path: Path, folder: str) -> None:
    (tmp_path / folder).mkdir()
    path = write(tmp_path, "plain.db3").rename(tmp_path / folder / "plain.db3")
    assert unpack_bag(path, tmp_path / "out").counts["imu"] == 4


@pytest.mark.parametrize("name", ["plain.db3", "plain.mcap"])
def test_a_folder_without_metadata_is_told_how_to_get_them(tmp_path: Path, name: str) -> None:
    """ROS 2 writes them when it closes a bag."""
    path = write(tmp_path, name)
    (path / "metadata.yaml").unlink()
    told = f"it holds {data_file(path).name}, which can be given itself"
    with pytest.raises(DatasetError, match=f"{told}.*ros2 bag reindex"), open_bag(path):
        pass
    with open_bag(data_file(path)) as bag:
        assert {topic.name for topic in bag.topics} == {"/imu", "/image"}


def test_a_file_that_ros_1_was_writing_is_told(tmp_path: Path) -> None:
    path = write(tmp_path, "plain.bag").rename(tmp_path / "drive.bag.active")
    with pytest.raises(DatasetError, match="rosbag reindex"), open_bag(path):
        pass


@pytest.mark.parametrize(
    ("name", "tool"),
    [("plain.bag", "rosbag reindex"), ("plain.mcap", "mcap recover"), ("plain.db3", r"\.recover")],
)
def test_a_damaged_bag_is_told_with_what_saves_it(tmp_path: Path, name: str, tool: str) -> None:
    path = write(tmp_path, name)
    file = data_file(path)
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 2 // 3])
    for given in {path, file}:
        with pytest.raises(DatasetError, match=f"is damaged, or no bag: .*{tool}"), open_bag(given) as bag:
            list(bag.messages(["/imu", "/image"]))


@pytest.mark.parametrize("is_folder", [True, False])
def test_messages_in_a_log_beside_the_file_are_not_left_out_without_a_word(
    tmp_path: Path, is_folder: bool
) -> None:
    """The library reads no write-ahead log: it would give the messages that it found merged."""
    path = write(tmp_path, "plain.db3")
    given = path if is_folder else data_file(path)
    base = sqlite3.connect(data_file(path))
    with closing(base):
        base.execute("PRAGMA journal_mode = WAL")
        with base:
            base.execute("DELETE FROM messages WHERE id = 1")
        with pytest.raises(DatasetError, match=r"was not closed: \S+-wal beside it"), open_bag(given):
            pass
    with open_bag(given) as bag:  # closed by SQLite
        assert len(list(bag.messages(["/imu", "/image"]))) == 4


def test_a_name_longer_than_any_file_has_is_refused() -> None:
    with pytest.raises(DatasetError, match="file name too long"), open_bag("x" * 1000):
        pass


@pytest.mark.parametrize("name", ["drive.bag", "drive.db3", "drive.mcap", "drive/metadata.yaml"])
def test_a_pipe_does_not_block(tmp_path: Path, name: str) -> None:
    (tmp_path / name).parent.mkdir(exist_ok=True)
    os.mkfifo(tmp_path / name)
    path = tmp_path / name.partition("/")[0]
    with pytest.raises(DatasetError, match=r"is not a regular file|is no bag"), open_bag(path):
        pass


@pytest.mark.parametrize(("name", "told"), [("none.bag", "no such file"), ("image.png", "is no bag")])
def test_what_is_no_bag_is_told(tmp_path: Path, name: str, told: str) -> None:
    (tmp_path / "image.png").touch()
    with pytest.raises(DatasetError, match=told), open_bag(tmp_path / name):
        pass


def test_without_the_library_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.rosbag1", None)
    with pytest.raises(DatasetError, match=r"pip install 'sfmcpp\[ros\]'"), open_bag(tmp_path / "a.bag"):
        pass
