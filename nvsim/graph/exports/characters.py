"""The characters that XML allows. Definition: https://www.w3.org/TR/xml/#charsets"""

from __future__ import annotations

import re

_ILLEGAL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def legal(text: str) -> str:
    """Return `text` with control characters and lone surrogates replaced by U+FFFD."""
    return _ILLEGAL.sub("\ufffd", text)
