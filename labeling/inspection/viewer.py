"""A label set in the browser: segmented clouds, boxes, cameras and their pictures, by viser (extra ``viewer``)."""

import contextlib
import socket
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from labeling.core.errors import SbmError, UsageError
from labeling.core.types import BOX_EDGES, Box3d
from labeling.core.views import Camera
from labeling.formats.atomic import atomic_file
from labeling.formats.film import write_film
from labeling.inspection.browser_cameras import aspect, fly, vertical_fov_rad, wxyz
from labeling.inspection.colouring import COLOURINGS, Rgb, object_colours, point_colours
from labeling.inspection.framing import SURE, below, cut_height_m, opening_view, region, spacing_m
from labeling.inspection.object_table import object_table
from labeling.inspection.orbit import FRAME_MS, SIZE, orbit
from labeling.inspection.scene import LabelledScene, SceneObject, together
from labeling.inspection.short_names import short_name
from labeling.inspection.view_thumbnails import Thumbnail, thumbnails
from labeling.runtime.extras import how_to_install

ALL = "all classes"
FOV_RAD = 0.8
FRAME_TIMEOUT_S = 20.0
TRUTH: Rgb = (0.1, 0.1, 0.12)
FRUSTUM_SHARE = 0.025
"""Length of a camera's pyramid, as a share of the diagonal of the region that objects take up."""


class SceneViewer:
    """What a browser shows of a label set, and the controls for it.

    Raises:
        UsageError: if viser is not installed, nothing can listen at the address, or there is nothing to show.
    """

    def __init__(self, labels: Path, scenes: list[LabelledScene], host: str, port: int) -> None:
        """Starts the viewer; it runs until the process ends.

        Args:
            labels: folder of the label set, whose pictures are read when they are first asked for.
            scenes: its episodes; the first is shown, the others can be chosen, and those of one scene together.
            host: of the address; 127.0.0.1 is seen by this machine alone.
            port: of the address; the next free one is taken if it is in use.
        """
        viser = _viser()
        if not scenes:
            raise UsageError("--view: no episode of this label set was labelled")
        _check_host(host)
        # Browsers' events come from threads of their own; controls that are set here call back, too.
        self._lock, self._opening = threading.RLock(), False
        self._labels = labels
        self._choices = choices(scenes)
        self.server = viser.ViserServer(host=host, port=port, label="Seeing by Moving", verbose=False)
        self.server.scene.set_up_direction("+z")
        self.server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        self._add_controls()
        self._pictures: dict[str, dict[int, tuple[Thumbnail, Thumbnail]]] = {}
        self._rows: dict[int, Any] = {}
        self._folder: Any = None
        self._open()

    @property
    def address(self) -> str:
        """Where to open it."""
        host = self.server.get_host()
        return f"http://{'localhost' if host in ('127.0.0.1', '0.0.0.0') else host}:{self.server.get_port()}"

    def write_html(self, folder: Path) -> list[Path]:
        """Writes every choice as one HTML file that needs no server, atomically; returns the files."""
        files = []
        for name, parts in self._choices.items():
            self.episode.value = name
            self._open()
            file = folder / f"{short_name('_'.join(scene.name for scene in parts))}.html"
            text = self.server.get_scene_serializer().as_html()
            with atomic_file(file) as temporary:
                temporary.write_text(text, encoding="utf-8")
            files.append(file)
        return files

    def _add_controls(self) -> None:
        gui = self.server.gui
        self.episode = gui.add_dropdown("episode", tuple(self._choices))
        self.home = gui.add_button("look at the room")
        self.film = gui.add_button("record a film", hint="circles what is shown; a GIF to save")
        self.colour = gui.add_dropdown("colour by", COLOURINGS)
        self.confidence = gui.add_slider("confidence at least", min=0.0, max=1.0, step=0.01, initial_value=SURE)
        self.category = gui.add_dropdown("class", (ALL,))
        with gui.add_folder("show", expand_by_default=True):
            self.boxes = gui.add_checkbox("boxes", initial_value=True)
            self.titles = gui.add_checkbox("titles", initial_value=True)
            self.truth = gui.add_checkbox("true boxes (black)", initial_value=False)
            self.cameras = gui.add_checkbox("cameras (click to fly there)", initial_value=True)
            self.pictures = gui.add_checkbox("their pictures", initial_value=False)
            self.masks = gui.add_checkbox("masks on pictures", initial_value=True)
            self.cut = gui.add_slider("cut off above, m", min=0.0, max=1.0, step=0.01, initial_value=1.0)
            self.point_size = gui.add_slider("point size", min=0.2, max=5.0, step=0.1, initial_value=1.0)
        self.go_to = gui.add_dropdown("fly to", ("-",))
        self.episode.on_update(lambda _: self._open())
        self.home.on_click(lambda event: self._look(event.client))
        self.film.on_click(lambda event: self._record(event.client))
        self.go_to.on_update(lambda event: self._go_to(event.client))
        for control in (self.colour, self.confidence, self.category, self.cut, self.boxes, self.titles, self.truth):
            control.on_update(lambda _: self._show())
        self.point_size.on_update(lambda _: self._show())
        for control in (self.cameras, self.pictures, self.masks):
            control.on_update(lambda _: self._show_cameras())

    def _open(self) -> None:
        """Shows what is chosen, from where there is a good view of it."""
        with self._lock:
            if not self._opening:
                self._opening = True
                try:
                    self._lay_out()
                finally:
                    self._opening = False
                self._show()
                self._show_cameras()

    def _lay_out(self) -> None:
        parts = self._choices[self.episode.value]
        self.scene = scene = parts[0] if len(parts) == 1 else together(parts)
        self._parts = parts
        centre, size_m = region(scene)
        # Browsers draw with 32 bits: what is far from the origin of its world frame is shown near it.
        self._origin_m = 100.0 * np.round(centre / 100.0)
        self._frustum_m = FRUSTUM_SHARE * float(np.linalg.norm(size_m))
        self._spacing_m = spacing_m(scene.points)
        heights = scene.points[:, 2] if len(scene.points) else np.array([0.0, 1.0])
        lowest = float(np.floor(10 * heights.min()) / 10)
        highest = max(float(np.ceil(10 * heights.max()) / 10), lowest + 0.1)
        with self.server.atomic():
            self.server.scene.reset()
            self.server.scene.set_up_direction("+z")
            self.cut.min, self.cut.max = lowest, highest
            self.cut.value = float(np.clip(cut_height_m(scene), lowest, highest))
            self.category.options = (ALL, *sorted({one.category for one in scene.objects}))
            self.category.value = ALL
            self.truth.visible = bool(scene.truth)
            self.go_to.options = ("-", *(one.title for one in scene.objects))
            self._list_objects()
            self._add_cameras()
        position, target = opening_view(scene, FOV_RAD)
        camera = self.server.initial_camera
        camera.position, camera.look_at = position - self._origin_m, target - self._origin_m
        camera.up, camera.fov = np.array([0.0, 0.0, 1.0]), FOV_RAD
        for client in self.server.get_clients().values():
            self._look(client)

    def _list_objects(self) -> None:
        """A table of the objects, and for each a box whose tick shows it."""
        if self._folder is not None:
            self._folder.remove()
        self._folder = self.server.gui.add_folder(f"objects ({len(self.scene.objects)})")
        with self._folder:
            self.table = self.server.gui.add_html(object_table(self.scene.objects))
            with self.server.gui.add_folder("show", expand_by_default=False):
                for one in self.scene.objects:
                    row = self.server.gui.add_checkbox(one.title, initial_value=True)
                    row.on_update(lambda _: self._show())
                    self._rows[one.number] = row

    def shown(self) -> list[SceneObject]:
        """The objects that confidence, class and list leave."""
        return [
            one
            for one in self.scene.objects
            if one.confidence >= self.confidence.value
            and self.category.value in (ALL, one.category)
            and self._rows[one.number].value
        ]

    def _show(self) -> None:
        """Draws cloud and boxes anew."""
        with self._lock:
            if not self._opening:
                self._draw()

    def _draw(self) -> None:
        scene, shown = self.scene, self.shown()
        colours = object_colours(scene, self.colour.value)
        kept = below(scene, float(self.cut.value))
        tinted = point_colours(scene, self.colour.value, [one.number for one in shown], colours)
        with self.server.atomic():
            self.server.scene.add_point_cloud(
                "/cloud",
                (scene.points[kept] - self._origin_m).astype(np.float32),
                tinted[kept],
                point_size=float(self.point_size.value) * self._spacing_m,
                precision="float32",
                point_shading="flat",
            )
            for one in scene.objects:
                self._show_box(one, one in shown, colours[one.number])
            self._show_truth()

    def _show_box(self, one: SceneObject, shown: bool, colour: Rgb) -> None:
        self._add_box(f"/boxes/{one.number}", one.box, colour, shown and bool(self.boxes.value))
        visible = shown and bool(self.titles.value)
        self.server.scene.add_label(f"/titles/{one.number}", one.title, position=self._top(one.box), visible=visible)

    def _show_truth(self) -> None:
        for number, one in enumerate(self.scene.truth, start=1):
            visible = bool(self.truth.value) and self.category.value in (ALL, one.category)
            self._add_box(f"/truth/{number}", one.box, TRUTH, visible)
            x, y, top = self._top(one.box)  # below, where no label's title stands
            named, place = visible and bool(self.titles.value), (x, y, top - float(np.ptp(one.box.corners()[:, 2])))
            self.server.scene.add_label(f"/truth/{number}/title", f"true {one.category}", position=place, visible=named)

    def _add_box(self, name: str, box: Box3d, colour: Rgb, visible: bool) -> None:
        corners = box.corners() - self._origin_m
        edges = np.array([[corners[a], corners[b]] for a, b in BOX_EDGES], np.float32)
        rgb = tuple(round(255 * value) for value in colour)
        how = {"thickness": 2.5, "thickness_units": "screen", "visible": visible}
        self.server.scene.add_line_segments(name, edges, colors=rgb, **how)

    def _top(self, box: Box3d) -> tuple[float, float, float]:
        x, y, _ = (box.centre_m - self._origin_m).tolist()
        return x, y, float((box.corners() - self._origin_m)[:, 2].max())

    def _add_cameras(self) -> None:
        """A pyramid for each view; clicking it flies there."""
        self._frustums: list[tuple[str, int, Any]] = []
        names = [(part.name, index, camera) for part in self._parts for index, camera in enumerate(part.cameras)]
        for number, (episode, index, camera) in enumerate(names):
            frustum = self.server.scene.add_camera_frustum(
                f"/cameras/{number}",
                fov=vertical_fov_rad(camera),
                aspect=aspect(camera),
                scale=self._frustum_m,
                thickness=1.5,
                thickness_units="screen",
                color=(60, 60, 60),
                wxyz=wxyz(camera.camera_to_world),
                position=tuple(camera.camera_to_world[:3, 3] - self._origin_m),
            )
            frustum.on_click(self._flight_to(camera))
            self._frustums.append((episode, index, frustum))

    def _flight_to(self, camera: Camera) -> Callable[[Any], None]:
        def fly_there(event: Any) -> None:
            fly(event.client, camera.camera_to_world, self._origin_m, vertical_fov_rad(camera))

        return fly_there

    def _show_cameras(self) -> None:
        with self._lock:
            if not self._opening:
                self._draw_cameras()

    def _draw_cameras(self) -> None:
        for episode, index, frustum in self._frustums:
            frustum.visible = bool(self.cameras.value)
            pair = self._pictures_of(episode).get(index) if self.pictures.value and self.cameras.value else None
            frustum.image = pair[int(bool(self.masks.value))] if pair else None

    def _pictures_of(self, episode: str) -> dict[int, tuple[Thumbnail, Thumbnail]]:
        """Of each view, read once; none if the recording cannot be read any more."""
        if episode not in self._pictures:
            (scene,) = (part for part in self._parts if part.name == episode)
            colours = {one.instance_id: one.colour for one in scene.objects}
            self._pictures[episode] = {}
            with contextlib.suppress(SbmError):
                self._pictures[episode] = thumbnails(self._labels, episode, colours)
        return self._pictures[episode]

    def _look(self, client: Any) -> None:
        """Back to the view that the viewer opens at."""
        position, target = opening_view(self.scene, FOV_RAD)
        with client.atomic():
            client.camera.up_direction = (0.0, 0.0, 1.0)
            client.camera.position, client.camera.look_at = position - self._origin_m, target - self._origin_m

    def _record(self, client: Any) -> None:
        """Sends a browser a film of what it shows, circling it; the browser draws the pictures."""
        try:
            frames = []
            for pose in orbit(self.scene, FOV_RAD):
                how = {"wxyz": wxyz(pose), "position": pose[:3, 3] - self._origin_m, "fov": FOV_RAD}
                frames.append(client.get_render(*SIZE, timeout=FRAME_TIMEOUT_S, **how))
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / f"{self.scene.name}.gif"
                write_film(frames, file, FRAME_MS, FRAME_MS)
                client.send_file_download(file.name, file.read_bytes())
        except (SbmError, TimeoutError) as error:
            client.add_notification("No film", str(error) or "the browser drew nothing", color="red")

    def _go_to(self, client: Any) -> None:
        chosen = [one for one in self.scene.objects if one.title == self.go_to.value]
        if not chosen or client is None:
            return
        box = chosen[0].box
        position, _ = opening_view(self.scene, FOV_RAD)
        direction = (position - box.centre_m) / np.linalg.norm(position - box.centre_m)
        distance_m = 1.5 * float(np.linalg.norm(box.extent_m))
        with client.atomic():
            client.camera.position = box.centre_m + distance_m * direction - self._origin_m
            client.camera.look_at = box.centre_m - self._origin_m


def choices(scenes: list[LabelledScene]) -> dict[str, list[LabelledScene]]:
    """What can be chosen, by name: every episode, and the episodes of each scene together where there are several."""
    found = {scene.name: [scene] for scene in scenes}
    places: dict[tuple[str, str], list[LabelledScene]] = {}
    for scene in scenes:
        if scene.place is not None:
            places.setdefault(scene.place, []).append(scene)
    for (world, name), parts in places.items():
        if len(parts) > 1:
            found[f"{' '.join(filter(None, (world, name)))}: {len(parts)} episodes"] = parts
    return found


def wait() -> None:
    """Keeps the viewer open until Ctrl-C."""
    with contextlib.suppress(KeyboardInterrupt):
        while True:
            time.sleep(1.0)


def _viser() -> Any:
    try:
        import viser  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise UsageError(f"--view and --html need viser; use --pictures DIR, or {how_to_install('viewer')}") from None
    return viser


def _check_host(host: str) -> None:
    """Raises UsageError if nothing can listen there: viser would only say so in a thread of its own."""
    try:
        with socket.create_server((host, 0)):
            pass
    except (OSError, UnicodeError) as error:
        raise UsageError(f"--host {host}: cannot be an address of this machine ({error})") from None
