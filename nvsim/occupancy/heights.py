"""The band over the floor in which something is in the way."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.errors import InputError


@dataclass(frozen=True)
class Heights:
    """Between which heights over the floor something is in the way. Raises InputError where there is nothing between
    them."""

    from_height: float = 0.1
    """Metres over the floor, of a map that is cut from three dimensions: what ends lower is stepped over."""
    to_height: float = 1.5
    """Metres over the floor: what begins higher is walked under."""

    def __post_init__(self) -> None:
        if not -1e3 < self.from_height < self.to_height < 1e3:
            raise InputError(
                f"There is nothing between {self.from_height:g} and {self.to_height:g} m over the floor; "
                "give --from-height a smaller number of metres than --to-height."
            )
