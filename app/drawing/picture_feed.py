"""Pictures of the reconstruction for one view: while the camera moves they come at a size that holds the pace; when it
rests, one at full size follows."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QObject, QTimer, Signal
from PySide6.QtGui import QImage

from app.drawing.pacing import Pacing
from app.drawing.render_child import Picture, RenderSource, Request, Trouble
from app.drawing.render_link import RenderLink
from app.drawing.renderer_choice import AUTOMATIC
from app.painting.cameras import ViewPose

REST = 100  # milliseconds without movement until the sharp image is asked for
PATIENCE = 4000  # milliseconds of loading until the user is told what may take so long
LOADING = "Loading the reconstruction…"
COMPILING = "Loading the reconstruction… What draws it is compiled for this machine once, which takes half a minute."
SCENE = "scene"  # the name under which it asks


class PictureFeed(QObject):
    """changed(): another image or another note; troubled(Trouble); remarked(Remark).

    size, pose   the device pixels of the view, and where its camera is, when they are needed
    """

    changed = Signal()
    troubled = Signal(object)
    remarked = Signal(object)

    def __init__(
        self, size: Callable[[], tuple[int, int]], pose: Callable[[], ViewPose], parent: QObject | None = None
    ) -> None:
        super().__init__(parent)
        self._size, self._pose = size, pose
        self.link = RenderLink(self)
        self.pacing = Pacing()
        self.channel = "rgb"
        self.renderer = AUTOMATIC
        self.budget = 0
        self.source: RenderSource | None = None
        self.note = ""  # what the view waits for
        self.picture: Picture | None = None
        self.image: QImage | None = None
        self._number = 0
        self._rest = QTimer(self, singleShot=True, interval=REST)
        self._rest.timeout.connect(self.ask_sharp)
        self._patience = QTimer(self, singleShot=True, interval=PATIENCE)
        self._patience.timeout.connect(self._say_more)
        self.link.arrived.connect(self._on_picture)
        self.link.opened.connect(lambda _: self._on_opened())
        self.link.troubled.connect(self._on_trouble)
        self.link.remarked.connect(self.remarked)

    @property
    def drawing(self) -> bool:
        """Whether an image is under way or about to be asked for."""
        return self._rest.isActive() or self.link.busy

    def show(self, source: RenderSource | None) -> None:
        """Draws this reconstruction from now on; None draws none. Of the same project, whose models were written again,
        the last image stays until the next is there, or the camera moves."""
        if source is None or source != self.source:
            self.picture = self.image = None
        self.source = source
        if source is None:
            self.link.close()
            self.note = ""
        else:
            self.note = LOADING
            self._patience.start()
            self.link.open(source)
        self.changed.emit()

    def follow(self) -> bool:
        """The camera moved. Returns whether an image of it will come, so that nothing is to be painted before."""
        self._rest.start()
        if not self.link.ready:
            self.picture = self.image = None  # it shows another place than the graph over it would
            return False
        self._ask(moving=True)
        return True

    def resize(self) -> None:
        """The view has another size: a sharp image follows."""
        self._rest.start()

    def ask_sharp(self) -> None:
        self._ask(moving=False)

    def release(self) -> None:
        """Ends the drawing process; not used afterwards."""
        self._rest.stop()
        self._patience.stop()
        self.link.close()

    def _ask(self, moving: bool) -> None:
        width, height = self._size()
        if moving:
            width, height = self.pacing.moving_size(width, height)
        self._number += 1
        camera = self._pose().camera(width, height)
        self.link.ask(Request(self._number, camera, self.channel, moving, self.renderer, SCENE, self.budget))

    def _say_more(self) -> None:
        if self.note == LOADING:
            self.note = COMPILING
            self.changed.emit()

    def _on_opened(self) -> None:
        self.note = ""
        self.ask_sharp()
        self.changed.emit()

    def _on_picture(self, picture: Picture) -> None:
        if picture.request.view != SCENE:
            return
        size = picture.request.camera.intrinsics
        if picture.request.moving:
            self.pacing.learn(size.width, size.height, *self._size(), picture.milliseconds)
        self.picture = picture
        # The image shares the array's memory; both are kept together.
        self.image = QImage(picture.pixels.data, size.width, size.height, 4 * size.width, QImage.Format.Format_RGB32)
        self.changed.emit()

    def _on_trouble(self, trouble: Trouble) -> None:
        self.note = trouble.message if trouble.fatal else self.note
        self.troubled.emit(trouble)
        self.changed.emit()
