"""The tasks of child processes in tests. The module imports little, so that the process starts quickly."""

from __future__ import annotations

import os
import sys
import time

from nvsim.errors import InputError


class Obedient:
    """Does what a request says."""

    def send_event(self, value: object) -> None:
        """Replaced in the child."""

    def __call__(self, request: tuple) -> object:
        match request:
            case ("pid",):
                return os.getpid()
            case ("twice", value):
                return value, value
            case ("tell", values):
                for value in values:
                    self.send_event(value)
                return "told"
            case ("refuse",):
                raise InputError("No; ask for another.")
            case ("mistake",):
                raise ZeroDivisionError("ours")
            case ("signal", number):
                os.kill(os.getpid(), number)
            case ("hold", size):
                return len(bytearray(size))
            case ("loop",):
                sys.setswitchinterval(1e6)  # no other thread runs, as in a library that holds Python's lock
                while True:
                    pass
        return None


class Silent:
    """Gives no answer within any limit of a test."""

    def __call__(self, request: object) -> None:
        time.sleep(300)
