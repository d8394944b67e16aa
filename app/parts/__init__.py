"""The parts of the window, in the order they are made. A new capability is a module here and a line in PARTS; the
window itself knows none of them."""

from __future__ import annotations

from app.actions import Action
from app.parts.camera import CameraPart
from app.parts.camera_path import CameraPathPart
from app.parts.checking import CheckPart
from app.parts.comparing import ComparePart
from app.parts.context import ContextPart
from app.parts.editing import EditPart
from app.parts.exporting import ExportPart
from app.parts.files import FilePart
from app.parts.foreign import ForeignPart
from app.parts.frames import FramePart
from app.parts.inspector import InspectorPart
from app.parts.jobs import JobsPart
from app.parts.keeping import KeepingPart
from app.parts.layers import LayersPart
from app.parts.look import LookPart
from app.parts.modes import ModePart
from app.parts.new_project import NewProjectPart
from app.parts.palette import PalettePart
from app.parts.panels import DetailsPart, LogPart, MapPart, SubmapPart
from app.parts.part import Part
from app.parts.proposing import ProposePart
from app.parts.results import ResultPart
from app.parts.selecting import SelectPart
from app.parts.storeys import StoreyPart
from app.parts.thresholds import ThresholdPart
from app.parts.view import ViewPart
from app.parts.views import ViewsPart

PARTS: tuple[type[Part], ...] = (
    FilePart,
    CameraPart,
    ViewPart,
    SubmapPart,
    FramePart,
    LayersPart,
    CameraPathPart,
    MapPart,
    DetailsPart,
    InspectorPart,
    ThresholdPart,
    JobsPart,
    NewProjectPart,
    ResultPart,
    LogPart,
    ModePart,
    EditPart,
    ContextPart,
    SelectPart,
    StoreyPart,
    CheckPart,
    ComparePart,
    ExportPart,
    ForeignPart,
    ProposePart,
    LookPart,
    PalettePart,
    ViewsPart,
    KeepingPart,
)

ACTIONS: tuple[Action, ...] = tuple(action for part in PARTS for action in part.ACTIONS)
