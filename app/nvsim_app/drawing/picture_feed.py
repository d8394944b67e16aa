"""The window's end of the rendering process, and images of the reconstruction for one view: reduced while the camera
moves, at full size when it rests."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable

from PySide6.QtCore import QObject, QTimer, Signal
from PySide6.QtGui import QImage

from nvsim.kernel_folder import compiled_since
from nvsim_app.drawing.marked_model import Marks
from nvsim_app.drawing.painter import LogRemark
from nvsim_app.drawing.panorama_child import Panorama, PanoramaRequest
from nvsim_app.drawing.render_child import Picture, RenderError, RenderSource, Request, serve
from nvsim_app.drawing.renderer_choice import AUTOMATIC
from nvsim_app.painting.cameras import ViewPose
from nvsim_app.processes.child import RESTARTS, ChildProgram
from nvsim_app.processes.serving import EndMessage
from nvsim_app.processes.side_process import SideProcess

_PROGRAM = ChildProgram(
    serve,
    "renderer",
    "The reconstruction cannot be rendered",
    "close other programs and open the file again",
    "The renderer stopped repeatedly, so the view is not updated; File > Refresh restarts it.",
    RESTARTS,
)


class RenderLink(SideProcess):
    """Renders a RenderSource. A newer request of a view replaces the waiting one.

    arrived(Picture)             an image
    panoramaArrived(Panorama)    a panorama
    troubled(Trouble)            an error
    remarked(Remark)             a message for the log
    """

    arrived = Signal(object)
    panoramaArrived = Signal(object)
    troubled = Signal(object)
    remarked = Signal(object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(_PROGRAM, parent)
        self._panorama: PanoramaRequest | None = None  # the unfinished panorama
        self.heard.connect(self._on_heard)
        self.restarted.connect(lambda: self.troubled.emit(RenderError("The renderer stopped and was restarted.")))
        self.ended.connect(self._on_failure)

    @property
    def busy(self) -> bool:
        """Whether an image is being rendered."""
        return self.ready and bool(self.unanswered - {PanoramaRequest})

    def ask(self, request: Hashable, slot: Hashable = None) -> None:
        super().ask(request, request.view if isinstance(request, Request) else slot)

    def ask_panorama(self, request: PanoramaRequest | None) -> None:
        """Requests a panorama, which replaces the previous request; None requests none. It is rendered between images
        and arrives several times, each time finer."""
        self._panorama = request
        if request is None:
            self.cancel(PanoramaRequest)
        else:
            self.ask(request)

    def _on_heard(self, message: object) -> None:
        if isinstance(message, Picture):
            self.arrived.emit(message)
        elif isinstance(message, Panorama):
            if self._panorama is not None and message.key == self._panorama.key:
                self._panorama = None if message.final else self._panorama
                self.panoramaArrived.emit(message)
        elif isinstance(message, LogRemark):
            self.remarked.emit(message)
        elif isinstance(message, RenderError):
            self.troubled.emit(message)

    def _on_failure(self, end: EndMessage) -> None:
        self.troubled.emit(RenderError(end.sentence, end.trace, fatal=True))


REST = 100  # milliseconds without movement until the sharp image is requested
PATIENCE = 4000  # milliseconds of loading between two checks whether kernels are being compiled
LOADING = "Loading the reconstruction…"
COMPILING = "Loading the reconstruction… The renderer is compiled once on this machine, which takes half a minute."
SMALLEST = (480, 270)  # smallest image of a moving camera, pixels
SCENE = "scene"  # the view name of its requests


class ImageSizeControl:
    """Learns the render time per pixel and chooses the image size that reaches the target time.

    target_ms   milliseconds from the request of a moving frame to its arrival (34: about 28 frames per second)
    """

    def __init__(self, target_ms: float = 34.0) -> None:
        self._target = target_ms
        self._area_share = 0.25

    def size_while_moving(self, width: int, height: int) -> tuple[int, int]:
        """The image size in pixels for a moving camera in a view of `width` x `height` device pixels. The aspect ratio
        is preserved."""
        factor = self._area_share**0.5
        least = max(SMALLEST[0] / width, SMALLEST[1] / height)
        factor = min(1.0, max(factor, least))
        if factor > 0.97:
            return width, height
        # Round to 16 pixels, because an image whose size changes with every frame flickers.
        w = min(width, max(SMALLEST[0], round(width * factor / 16) * 16))
        return w, max(1, round(height * w / width))

    def learn(self, width: int, height: int, full_width: int, full_height: int, milliseconds: float) -> None:
        """Records that a frame of `width` x `height` pixels took `milliseconds`."""
        share = width * height / max(1, full_width * full_height)
        wanted = share * self._target / max(milliseconds, 0.5)
        # Shrink quickly and grow slowly: a late frame disturbs more than a slightly coarse one.
        blend = 0.6 if wanted < self._area_share else 0.15
        self._area_share = min(1.0, max(0.005, self._area_share + blend * (wanted - self._area_share)))


class PictureFeed(QObject):
    """Requests the images of one view, and stores the newest image.

    size   returns the size of the view in device pixels
    pose   returns the camera pose of the view

    changed() is emitted after a new image or note. troubled(Trouble) and remarked(Remark) forward messages of the
    rendering process.
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
        self.pacing = ImageSizeControl()
        self.channel = "rgb"
        self.renderer = AUTOMATIC
        self.budget = 0
        self.marks: Marks | None = None
        self.source: RenderSource | None = None
        self.note = ""  # why there is no image yet
        self.picture: Picture | None = None
        self.image: QImage | None = None
        self._number = 0
        self._rest = QTimer(self, singleShot=True, interval=REST)
        self._rest.timeout.connect(self.request_sharp_image)
        self._begun = 0.0  # when loading began, seconds since the epoch
        self._patience = QTimer(self, interval=PATIENCE)
        self._patience.timeout.connect(self._say_more)
        self.link.arrived.connect(self._on_picture)
        self.link.opened.connect(self._on_opened)
        self.link.troubled.connect(self._on_trouble)
        self.link.remarked.connect(self.remarked)

    @property
    def drawing(self) -> bool:
        """Whether an image is being rendered or will be requested soon."""
        return self._rest.isActive() or self.link.busy

    def show(self, source: RenderSource | None) -> None:
        """Renders this reconstruction; None stops rendering. If the source is the same but its models changed, the last
        image stays until the next one arrives or the camera moves."""
        if source is None or source != self.source:
            self.picture = self.image = None
        self.source = source
        if source is None:
            self.link.close()
            self.note = ""
        else:
            self.note, self._begun = LOADING, time.time()
            self._patience.start()
            self.link.open(source)
        self.changed.emit()

    def request_after_move(self) -> bool:
        """Requests an image after the camera moved. Returns whether one will come; if so, do not repaint before."""
        self._rest.start()
        if not self.link.ready:
            self.picture = self.image = None  # the old image does not fit the graph overlay
            return False
        self._ask(moving=True)
        return True

    def resize(self) -> None:
        """Requests a sharp image after the size of the view changed."""
        self._rest.start()

    def request_sharp_image(self) -> None:
        self._ask(moving=False)

    def release(self) -> None:
        """Ends the rendering process. The feed must not be used afterward."""
        self._rest.stop()
        self._patience.stop()
        self.link.close()

    def _ask(self, moving: bool) -> None:
        width, height = self._size()
        if moving:
            width, height = self.pacing.size_while_moving(width, height)
        self._number += 1
        camera = self._pose().camera(width, height)
        asked = Request(self._number, camera, self.channel, moving, self.renderer, SCENE, self.budget, marks=self.marks)
        self.link.ask(asked)

    def _say_more(self) -> None:
        if self.note != LOADING:
            self._patience.stop()
        elif compiled_since(self._begun):
            self.note = COMPILING
            self.changed.emit()

    def _on_opened(self) -> None:
        self.note = ""
        self.request_sharp_image()
        self.changed.emit()

    def _on_picture(self, picture: Picture) -> None:
        if picture.request.view != SCENE:
            return
        size = picture.request.camera.intrinsics
        if picture.request.moving:
            self.pacing.learn(size.width, size.height, *self._size(), picture.milliseconds)
        self.picture = picture
        # The image shares the memory of the array, so both are stored.
        self.image = QImage(picture.pixels.data, size.width, size.height, 4 * size.width, QImage.Format.Format_RGB32)
        self.changed.emit()

    def _on_trouble(self, trouble: RenderError) -> None:
        self.note = trouble.message if trouble.fatal else self.note
        self.troubled.emit(trouble)
        self.changed.emit()
