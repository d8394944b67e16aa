"""The height band over the floor in which objects are obstacles."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.errors import InputError


@dataclass(frozen=True)
class Heights:
    """Heights over the floor between which objects are obstacles. Raises InputError if the band is empty or too
    large."""

    from_height: float = 0.1
    """Meters over the floor, for a map from 3D data: lower objects can be stepped over."""
    to_height: float = 1.5
    """Meters over the floor: higher objects can be walked under."""

    def __post_init__(self) -> None:
        if not -1e3 < self.from_height < self.to_height < 1e3:
            raise InputError(
                f"The band from {self.from_height:g} to {self.to_height:g} m over the floor is empty or too large; "
                "give --from-height a smaller number of meters than --to-height."
            )
