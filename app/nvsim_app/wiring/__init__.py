"""The parts of the window, in the order of construction. A new capability is a module here and a row in PARTS; the
window itself only iterates over PARTS."""

from __future__ import annotations

from nvsim_app.actions import Action
from nvsim_app.wiring.agent import AgentPart
from nvsim_app.wiring.appearance import FocusPart, LookPart, PalettePart, PreferencePart
from nvsim_app.wiring.camera import CameraPart, ViewPart
from nvsim_app.wiring.camera_path import CameraPathPart
from nvsim_app.wiring.checking import CheckPart, ComparePart
from nvsim_app.wiring.cleaning import CleanPart
from nvsim_app.wiring.display import ColoringPart, StoreyPart
from nvsim_app.wiring.editing import AutosavePart, EditPart, FeedbackPart
from nvsim_app.wiring.exporting import ExportPart
from nvsim_app.wiring.files import FilePart, ForeignPart, RecentPart
from nvsim_app.wiring.frames import FramePart
from nvsim_app.wiring.importing import ReimportPart
from nvsim_app.wiring.inspector import InspectorPart
from nvsim_app.wiring.jobs import JobsPart, TrainingPart
from nvsim_app.wiring.modes import ContextPart, ModePart
from nvsim_app.wiring.new_project import NewProjectPart
from nvsim_app.wiring.panels import DetailsPart, LayersPart, LogPart, MapPart, ModelsPart, ResultPart, SubmapPart
from nvsim_app.wiring.part import Part
from nvsim_app.wiring.proposing import ProposePart
from nvsim_app.wiring.selecting import SelectPart
from nvsim_app.wiring.tasks import TaskPart
from nvsim_app.wiring.thresholds import CalibratePart, ThresholdPart
from nvsim_app.wiring.views import ViewRestorePart, ViewsPart
from nvsim_app.wiring.workspace_layouts import WorkspacePart

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
    CleanPart,
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
