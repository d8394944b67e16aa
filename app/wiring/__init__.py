"""The parts of the window, in the order of construction. A new capability is a module here and a row in PARTS; the
window itself only iterates over PARTS."""

from __future__ import annotations

from app.actions import Action
from app.wiring.agent import AgentPart
from app.wiring.appearance import FocusPart, LookPart, PalettePart, PreferencePart
from app.wiring.camera import CameraPart, ViewPart
from app.wiring.camera_path import CameraPathPart
from app.wiring.checking import CheckPart, ComparePart
from app.wiring.display import ColoringPart, StoreyPart
from app.wiring.editing import AutosavePart, EditPart, FeedbackPart
from app.wiring.exporting import ExportPart
from app.wiring.files import FilePart, ForeignPart, RecentPart
from app.wiring.frames import FramePart
from app.wiring.importing import ReimportPart
from app.wiring.inspector import InspectorPart
from app.wiring.jobs import JobsPart, TrainingPart
from app.wiring.modes import ContextPart, ModePart
from app.wiring.new_project import NewProjectPart
from app.wiring.panels import DetailsPart, LayersPart, LogPart, MapPart, ModelsPart, ResultPart, SubmapPart
from app.wiring.part import Part
from app.wiring.proposing import ProposePart
from app.wiring.selecting import SelectPart
from app.wiring.tasks import TaskPart
from app.wiring.thresholds import CalibratePart, ThresholdPart
from app.wiring.views import ViewRestorePart, ViewsPart
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
