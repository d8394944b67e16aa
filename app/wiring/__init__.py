"""The parts of the window, in the order of construction. A new capability is a module here and a row in PARTS; the
window itself only iterates over PARTS."""

from __future__ import annotations

from app.actions import Action
from app.wiring.agent import AgentPart
from app.wiring.autosave import AutosavePart
from app.wiring.calibrating import CalibratePart
from app.wiring.camera import CameraPart
from app.wiring.camera_path import CameraPathPart
from app.wiring.checking import CheckPart
from app.wiring.coloring import ColoringPart
from app.wiring.comparing import ComparePart
from app.wiring.context import ContextPart
from app.wiring.editing import EditPart
from app.wiring.exporting import ExportPart
from app.wiring.feedback import FeedbackPart
from app.wiring.files import FilePart
from app.wiring.foreign import ForeignPart
from app.wiring.frames import FramePart
from app.wiring.importing import ReimportPart
from app.wiring.inspector import InspectorPart
from app.wiring.jobs import JobsPart
from app.wiring.layers import LayersPart
from app.wiring.look import LookPart
from app.wiring.models import ModelsPart
from app.wiring.modes import ModePart
from app.wiring.new_project import NewProjectPart
from app.wiring.palette import PalettePart
from app.wiring.pane_focus import FocusPart
from app.wiring.panels import DetailsPart, LogPart, MapPart, SubmapPart
from app.wiring.part import Part
from app.wiring.preferences import PreferencePart
from app.wiring.proposing import ProposePart
from app.wiring.recent import RecentPart
from app.wiring.results import ResultPart
from app.wiring.selecting import SelectPart
from app.wiring.storeys import StoreyPart
from app.wiring.tasks import TaskPart
from app.wiring.thresholds import ThresholdPart
from app.wiring.training import TrainingPart
from app.wiring.view import ViewPart
from app.wiring.view_restore import ViewRestorePart
from app.wiring.views import ViewsPart
from app.wiring.workspace_layouts import WorkspacePart

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
    AgentPart,
    ThresholdPart,
    JobsPart,
    NewProjectPart,
    RecentPart,
    ModelsPart,
    TrainingPart,
    ResultPart,
    LogPart,
    CalibratePart,
    ModePart,
    ReimportPart,
    EditPart,
    ContextPart,
    SelectPart,
    StoreyPart,
    ColoringPart,
    CheckPart,
    FeedbackPart,
    ComparePart,
    TaskPart,
    ExportPart,
    ForeignPart,
    ProposePart,
    LookPart,
    AutosavePart,
    FocusPart,
    PreferencePart,
    PalettePart,
    ViewsPart,
    ViewRestorePart,
    WorkspacePart,
)


def actions() -> tuple[Action, ...]:
    """The commands of all parts."""
    return tuple(action for part in PARTS for action in part.actions())
