"""A connection to a SQLite file that may be damaged: a query that reaches a damaged page raises InputError."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

from nvsim.errors import InputError

T = TypeVar("T")


def damaged(path: Path, error: Exception) -> InputError:
    """The error message for a damaged database."""
    words = "".join(c if c.isprintable() else "?" for c in str(error))[:80]
    return InputError(f"{path} is damaged ({words}); restore the project from a copy or import it again.")


class GuardedConnection(sqlite3.Connection):
    """Raises InputError if the file is damaged. A full disk, a lock, or an invalid statement still raises
    sqlite3.Error."""

    path = Path()

    def cursor(self, factory: Any = None) -> Any:
        made = super().cursor(factory or GuardedCursor)
        if isinstance(made, GuardedCursor):
            made.path = self.path
        return made

    def execute(self, sql: str, parameters: Any = (), /) -> Any:
        return self.cursor().execute(sql, parameters)

    def executemany(self, sql: str, parameters: Iterable[Any], /) -> Any:
        return self.cursor().executemany(sql, parameters)

    def executescript(self, script: str, /) -> Any:
        return self.cursor().executescript(script)


class GuardedCursor(sqlite3.Cursor):
    path = Path()

    def execute(self, sql: str, parameters: Any = (), /) -> Any:
        return self._held(super().execute, sql, parameters)

    def executemany(self, sql: str, parameters: Iterable[Any], /) -> Any:
        return self._held(super().executemany, sql, parameters)

    def executescript(self, script: str, /) -> Any:
        return self._held(super().executescript, script)

    def fetchone(self) -> Any:
        return self._held(super().fetchone)

    def fetchall(self) -> list[Any]:
        return self._held(super().fetchall)

    def __next__(self) -> Any:
        return self._held(super().__next__)

    def _held(self, call: Callable[..., T], *arguments: Any) -> T:
        try:
            return call(*arguments)
        except sqlite3.DatabaseError as error:
            if type(error) is sqlite3.DatabaseError:  # its subclasses have other causes
                raise damaged(self.path, error) from error
            raise
        except UnicodeDecodeError as error:  # SQLite's own message quotes the damaged text
            raise damaged(self.path, error) from error
