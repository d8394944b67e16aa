"""The one error a user can cause: a sentence that says what is wrong, where, and what to do."""


class InputError(Exception):
    """Something outside the program is wrong (a file, a flag, a full disk).

    The message is one sentence for the user: what, where (file, line, frame), what to do.
    The command line prints it and exits with code 2; the window shows it as a notice.
    """
