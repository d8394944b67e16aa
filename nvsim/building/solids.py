"""The solids of the building: axis-aligned boxes with painted faces, and the walls of a plan as such boxes."""

from __future__ import annotations

from dataclasses import dataclass, replace

from nvsim.building.plan import GLASS, HEIGHT, Opening, Plan, Rect, Wall

Color = tuple[float, float, float]
# Faces of a box, in this order in all modules: -x, +x, -y, +y, -z, +z
LEFT, RIGHT, FRONT, BACK, BOTTOM, TOP = range(6)


@dataclass(frozen=True)
class Paint:
    """The paint of a face for `painting`: a kind, its main color, and a second color (RGB, 0 to 1)."""

    kind: str
    color: Color
    accent: Color = (0.2, 0.2, 0.2)


@dataclass(frozen=True)
class Box:
    """An axis-aligned solid, meters. `faces` overrides the paint of single faces. People walk on top of a `tread`."""

    lo: tuple[float, float, float]
    hi: tuple[float, float, float]
    paint: Paint
    faces: tuple[tuple[int, Paint], ...] = ()
    glass: bool = False
    tread: bool = False

    @property
    def ground(self) -> Rect:
        return Rect(self.lo[0], self.lo[1], self.hi[0], self.hi[1])

    def face_paint(self, face: int) -> Paint:
        return next((p for f, p in self.faces if f == face), self.paint)


_FRAME = 0.055  # width of a door frame's post, meters
_GLASS_PAINT = Paint("plain", (0.8, 0.85, 0.85))
_METAL = Paint("plain", (0.38, 0.39, 0.41))


def raised(box: Box, height: float) -> Box:
    """The box moved up by `height` meters."""
    (x0, y0, z0), (x1, y1, z1) = box.lo, box.hi
    return replace(box, lo=(x0, y0, z0 + height), hi=(x1, y1, z1 + height))


def _upright(along: str, line: float, half: float, start: float, end: float) -> Rect:
    return Rect(start, line - half, end, line + half) if along == "x" else Rect(line - half, start, line + half, end)


def _box(ground: Rect, low: float, high: float, paint: Paint, glass: bool = False) -> Box:
    return Box((ground.x0, ground.y0, low), (ground.x1, ground.y1, high), paint, (), glass)


def wall_boxes(plan: Plan, wall_paints: dict[str, Paint], frame: Paint) -> list[Box]:
    """Every wall of the plan as boxes that each face one room per side, cut at the openings, with lintels and frames.

    `wall_paints` maps room names to the paint of their walls.
    """
    boxes: list[Box] = []
    for wall in plan.walls:
        openings = sorted(
            (
                o
                for o in plan.openings
                if o.along == wall.along and o.line == wall.line and wall.start < o.center < wall.end
            ),
            key=lambda o: o.center,
        )
        if wall.glass:
            boxes += _glass_wall(wall, openings, frame)
            continue
        cuts = {wall.start, wall.end}
        for other in plan.walls:
            if (
                other.along != wall.along
                and wall.start < other.line < wall.end
                and _touches_wall_line(other, wall.line)
            ):
                cuts.add(other.line)
        edges = sorted(cuts)
        for start, end in zip(edges, edges[1:]):
            here = start
            for o in (o for o in openings if start < o.center < end):
                gap = (o.center - o.width / 2, o.center + o.width / 2)
                if o.framed:
                    gap = (gap[0] - _FRAME, gap[1] + _FRAME)
                boxes.append(_piece(plan, wall, here, gap[0], 0.0, HEIGHT, wall_paints))
                boxes.append(_piece(plan, wall, gap[0], gap[1], o.height, HEIGHT, wall_paints))
                boxes += _door_frame(o, wall.thickness, frame) if o.framed else []
                here = gap[1]
            boxes.append(_piece(plan, wall, here, end, 0.0, HEIGHT, wall_paints))
    return boxes


def _touches_wall_line(other: Wall, line: float) -> bool:
    return other.start - 0.1 <= line <= other.end + 0.1


def _piece(plan: Plan, wall: Wall, start: float, end: float, low: float, high: float, paints: dict[str, Paint]) -> Box:
    ground = _upright(wall.along, wall.line, wall.thickness / 2, start, end)
    middle = (start + end) / 2
    faces = []
    for sign, face in ((-1, FRONT if wall.along == "x" else LEFT), (1, BACK if wall.along == "x" else RIGHT)):
        side = wall.line + sign * (wall.thickness / 2 + 0.05)
        room = plan.room_at(middle, side) if wall.along == "x" else plan.room_at(side, middle)
        if room is not None:
            faces.append((face, paints[room.name]))
    plain = Paint("plain", (0.78, 0.77, 0.74))
    box = _box(ground, low, high, plain)
    return Box(box.lo, box.hi, plain, tuple(faces))


def _door_frame(o: Opening, thickness: float, paint: Paint) -> list[Box]:
    half, out = o.width / 2, thickness / 2 + 0.02
    left = _upright(o.along, o.line, out, o.center - half - _FRAME - 0.03, o.center - half)
    right = _upright(o.along, o.line, out, o.center + half, o.center + half + _FRAME + 0.03)
    over = _upright(o.along, o.line, out, o.center - half - _FRAME - 0.03, o.center + half + _FRAME + 0.03)
    return [
        _box(left, 0.0, o.height + 0.06, paint),
        _box(right, 0.0, o.height + 0.06, paint),
        _box(over, o.height - 0.03, o.height + 0.06, paint),
    ]


def _glass_wall(wall: Wall, openings: list[Opening], frame: Paint) -> list[Box]:
    """Panes from floor to ceiling, with glass above the openings between them."""
    boxes: list[Box] = []
    start = wall.start
    for o in openings:
        left, right = o.center - o.width / 2 - _FRAME, o.center + o.width / 2 + _FRAME
        boxes += _glass_panel(replace(wall, start=start, end=left))
        boxes.append(
            _box(_upright(wall.along, wall.line, GLASS / 2, left, right), o.height, HEIGHT, _GLASS_PAINT, glass=True)
        )
        boxes += _door_frame(o, 0.08, frame)
        start = right
    return boxes + _glass_panel(replace(wall, start=start))


def _glass_panel(wall: Wall) -> list[Box]:
    """A pane from floor to ceiling with a thin rail above and below and posts at its ends."""
    pane = _upright(wall.along, wall.line, GLASS / 2, wall.start, wall.end)
    rail = _upright(wall.along, wall.line, 0.025, wall.start, wall.end)
    ends = [
        _upright(wall.along, wall.line, 0.06, wall.start, wall.start + 0.12),
        _upright(wall.along, wall.line, 0.06, wall.end - 0.12, wall.end),
    ]
    return [
        _box(pane, 0.0, HEIGHT, _GLASS_PAINT, glass=True),
        _box(rail, 0.0, 0.04, _METAL),
        _box(rail, HEIGHT - 0.05, HEIGHT, _METAL),
        *(_box(e, 0.0, HEIGHT, _METAL) for e in ends),
    ]
