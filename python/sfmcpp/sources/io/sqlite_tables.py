"""Tables of SQLite files from strangers: only what is stored is read.

A view or a computed column is a formula that the file brings along: it might never end, or make gigabytes of
a file of kilobytes.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import quote

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.files import is_present


def read_only_uri(path: Path, *, is_unchanged: bool = True) -> str:
    """How to open a file. Where nobody writes it, no lock is taken, and nothing is made beside it."""
    return f"file:{quote_path(path)}?mode=ro{'&immutable=1' if is_unchanged else ''}"


def log_beside(path: Path) -> Path | None:
    """A write-ahead log or a journal that holds something which belongs to a file, or None."""
    beside = (path.with_name(path.name + suffix) for suffix in ("-wal", "-journal"))
    return next((file for file in beside if is_present(file) and file.stat().st_size), None)


def quote_path(path: Path) -> str:
    """A path as a URI holds it, where ``#``, ``?`` and ``%`` have meanings of their own."""
    return quote(bytes(path))


def require_stored(connection: sqlite3.Connection, path: Path, names: Iterable[str]) -> None:
    """Refuse a database of whose tables one of these names is there and is not stored as it is read.

    Raises
    ------
    DatasetError
        If one is a view, or has columns that are computed.
    """
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.set_authorizer(_deny_formulas)
    for name in names:
        columns = list(connection.execute(f"PRAGMA table_xinfo({name})"))
        if any(hidden for *_, hidden in columns):
            raise DatasetError(path, f"table {name} has columns that are computed: all must be stored")
        if columns and not _is_allowed(connection, name):
            raise DatasetError(path, f"{name} is a view: must be a table")
    connection.set_authorizer(None)


def _is_allowed(connection: sqlite3.Connection, name: str) -> bool:
    """Whether reading it is allowed. What the list of tables says need not be true."""
    try:
        connection.execute(f"EXPLAIN SELECT * FROM {name}").fetchone()
    except sqlite3.DatabaseError as error:
        if "prohibited" in str(error) or "not authorized" in str(error):
            return False
        raise
    return True


def _deny_formulas(
    action: int, what: str | None, part: str | None, database: str | None, inside: str | None
) -> int:
    """Deny whatever is done for a view or a trigger; a view is known by its name as what it is done for."""
    is_denied = inside is not None or action == sqlite3.SQLITE_RECURSIVE
    return sqlite3.SQLITE_DENY if is_denied else sqlite3.SQLITE_OK
