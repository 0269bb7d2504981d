"""The ``gl`` renderer: MuJoCo's own OpenGL renderer, driven by its low-level calls.

One pass gives colour where it is wanted, one gives depth and ids. Cost follows triangles, so it shines on a GPU; on a
CPU ``rays`` draws shadows faster. It agrees with ``rays`` on what is where (both sides of surfaces, through glass,
through holes in leaves); its colours are those of OpenGL's fixed pipeline: light per vertex, no bounced light, no
linear colour.
"""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8

from labeling.core.views import Camera
from sbm_gym.rendering.base import Frame, check_camera, check_geoms, pixel_to_world
from sbm_gym.rendering.gl.context import GlContext
from sbm_gym.rendering.gl.lights import place_lights
from sbm_gym.rendering.gl.two_sided_meshes import two_sided_meshes
from sbm_gym.rendering.tables.lights import LightMeter, sky_of
from sbm_gym.rendering.tables.scene_tables import GLASS, HOLES, geom_kinds, visible_geoms
from sbm_gym.rendering.tables.sky import add_haze, sky_colour
from sbm_gym.rendering.tables.texture_sampling import HOLE_ALPHA

SHADOW_SIZES = {"off": 0, "low": 1024, "high": 4096}
"""Texels along the edge of a shadow map, by quality."""
SUPERSAMPLING = 2
"""Anti-aliased pictures are drawn this much larger and filtered down: multisampling would spoil the depth buffer."""
NEAR_M = 0.01
FAR_M = 2000.0
"""Clipping planes. MuJoCo's depth buffer is reversed floating point, exact over the whole range."""
DETAIL = 64
"""Facets around cylinders and spheres, as fine as those of ``rays``."""
_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)
_PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
_NOTHING = int(mujoco.mjtGeom.mjGEOM_NONE)


class GlRenderer:
    """Draws a compiled model with OpenGL. Implements ``sbm_gym.rendering.base.Renderer``.

    The graphics card is first touched by the first picture. Pictures may come from any thread, but one at a time.
    """

    def __init__(self, model: mujoco.MjModel, *, shadows: str | bool = "high") -> None:
        """Prepares to draw a model.

        Args:
            model: the compiled model; it is read now and when the first picture is drawn.
            shadows: quality of shadows: "off", "low" or "high"; True and False mean "high" and "off".

        Raises:
            ValueError: if there is no such quality.
        """
        quality = {True: "high", False: "off"}.get(shadows, shadows) if isinstance(shadows, bool) else shadows
        if quality not in SHADOW_SIZES:
            raise ValueError(f"unknown shadow quality {shadows!r}; known: {', '.join(SHADOW_SIZES)}")
        self._model = model
        self._shadow_size = SHADOW_SIZES[quality]
        self._context: GlContext | None = None
        self._mjr: Any = None
        self._meter = LightMeter()
        self._kind = geom_kinds(model)
        self._is_two_sided = two_sided_meshes(model) & (self._kind != GLASS)
        self._has_skybox = bool(np.any(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX))
        self._drawn = set(np.flatnonzero(visible_geoms(model)).tolist())
        self._options = _scene_options()
        self._camera = mujoco.MjvCamera()
        self._camera.type = int(mujoco.mjtCamera.mjCAMERA_USER)
        # One more than there are geoms, since a full scene is reported as an error.
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + 1)
        # Surfaces have two sides, as with rays: furniture models are not always wound the right way round.
        self._scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        self._geoms = self._scene.geoms
        # What is read back, kept from picture to picture: colours and ids, each with its depth.
        self._rgb, self._far = np.empty((0, 0, 3), np.uint8), np.empty((0, 0), np.float32)
        self._ids, self._raw_depth = np.empty((0, 0, 3), np.uint8), np.empty((0, 0), np.float32)

    def render(self, data: mujoco.MjData, camera: Camera, *, antialias: bool = True, colours: bool = True) -> Frame:
        """Draws the scene as it stands in ``data``; see ``Renderer.render``.

        Raises:
            ValueError: as there, and if the pixels are sheared.
            NoOpenGlError: if there is no OpenGL on this machine.
        """
        _check(camera)
        height_px, width_px = camera.size
        scale = SUPERSAMPLING if antialias and colours else 1
        with self._opened(scale * height_px, scale * width_px).current():
            self._place(data, camera)
            geom_id, depth_m = self._draw_ids(camera.size)
            if not colours:
                return Frame(np.zeros((*camera.size, 3), np.uint8), depth_m, geom_id)
            rgb = self._draw_colour(data, camera, scale)
        sky, haze_per_m = sky_of(self._model)
        if haze_per_m > 0.0:
            rgb = add_haze(rgb, depth_m, camera.intrinsics, sky, haze_per_m)
        return Frame(rgb, depth_m, geom_id)

    def amodal_mask(self, data: mujoco.MjData, geom_ids: Sequence[int], camera: Camera) -> Bool[np.ndarray, "h w"]:
        """Pixels whose centre would show one of these geoms if nothing else were there; see ``Renderer``.

        Raises:
            ValueError: as there, and if the pixels are sheared.
            NoOpenGlError: if there is no OpenGL on this machine.
        """
        _check(camera)
        geoms = check_geoms(self._model, geom_ids)
        if not geoms & self._drawn:
            return np.zeros(camera.size, bool)
        with self._opened(*camera.size).current():
            self._place(data, camera)
            geom_id, _ = self._draw_ids(camera.size, only=geoms)
        return geom_id >= 0

    def close(self) -> None:
        """Frees the graphics card's memory; the next picture takes it again."""
        context = getattr(self, "_context", None)  # not there where __init__ has failed
        if context is not None:
            context.free()
            self._context = self._mjr = None

    __del__ = close

    def _opened(self, height_px: int, width_px: int) -> GlContext:
        """The context, made if there is none, with room for a picture of this size."""
        if self._context is None:
            context = GlContext()
            with context.current():
                self._mjr = self._make_mjr(height_px, width_px)
            context.own(self._mjr)
            self._context = context
        mjr = self._mjr
        if mjr.offWidth < width_px or mjr.offHeight < height_px:
            with self._context.current():
                mujoco.mjr_resizeOffscreen(max(width_px, mjr.offWidth), max(height_px, mjr.offHeight), mjr)
        return self._context

    def _make_mjr(self, height_px: int, width_px: int) -> mujoco.MjrContext:
        """Sends the model to the graphics card. MuJoCo reads the settings from the model, which gets its own back."""
        quality, buffer = self._model.vis.quality, self._model.vis.global_
        ours = [
            (quality, "offsamples", 0),
            (quality, "shadowsize", self._shadow_size),
            (quality, "numslices", DETAIL),
            (quality, "numstacks", DETAIL // 2),
            (buffer, "offwidth", width_px),
            (buffer, "offheight", height_px),
        ]
        before = [getattr(holder, name) for holder, name, _ in ours]
        try:
            for holder, name, value in ours:
                setattr(holder, name, value)
            mjr = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        finally:
            for (holder, name, _), value in zip(ours, before, strict=True):
                setattr(holder, name, value)
        mjr.readDepthMap = int(mujoco.mjtDepthMap.mjDEPTH_ZEROFAR)
        return mjr

    def _place(self, data: mujoco.MjData, camera: Camera) -> None:
        """Brings scene and camera up to date."""
        _, down, forward, position = np.asarray(camera.camera_to_world, float)[:3].T
        (fx, _, cx), (_, fy, cy) = camera.intrinsics[:2]
        height_px, width_px = camera.size
        # Pixel centres are integers, so the picture's edges lie half a pixel outside the first and last of them.
        left, stop = (-0.5 - cx) / fx, (width_px - 0.5 - cx) / fx
        top, bottom = (cy + 0.5) / fy, (cy + 0.5 - height_px) / fy
        for eye in self._scene.camera:
            eye.pos, eye.forward, eye.up = position, forward, -down
            eye.frustum_center, eye.frustum_width = NEAR_M * 0.5 * (left + stop), NEAR_M * 0.5 * (stop - left)
            eye.frustum_top, eye.frustum_bottom = NEAR_M * top, NEAR_M * bottom
            eye.frustum_near, eye.frustum_far = NEAR_M, FAR_M
        mujoco.mjv_updateScene(
            self._model,
            data,
            self._options,
            None,
            self._camera,
            int(mujoco.mjtCatBit.mjCAT_STATIC) | int(mujoco.mjtCatBit.mjCAT_DYNAMIC),
            self._scene,
        )
        self._cut_out: list[tuple[int, int]] = []
        for index in range(self._scene.ngeom):
            geom = self._geoms[index]
            number = geom.objid
            if (self._kind[number] == HOLES and geom.type == _MESH) or self._is_two_sided[number]:
                # MuJoCo does not cut out what a texture leaves transparent, nor can it leave out the side of a cloth
                # that is not seen: these are drawn afterwards.
                self._cut_out.append((index, number))
                geom.type = _NOTHING
            elif geom.type == _PLANE and float(np.dot(position - geom.pos, geom.mat[:, 2])) < 0.0:
                # Planes have one side only, as for MuJoCo's own rays.
                geom.type = _NOTHING
            elif self._kind[number] == GLASS:
                # MuJoCo draws glass twice, so each time lets more light through.
                geom.rgba[3] = 1.0 - np.sqrt(1.0 - geom.rgba[3])

    def _draw_ids(
        self, size: tuple[int, int], only: set[int] | None = None
    ) -> tuple[Int32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
        """Ids and depth of the surfaces behind glass. What is not in ``only`` is left out."""
        scene = self._scene
        for index in range(scene.ngeom):
            number = self._geoms[index].objid
            shown = self._kind[number] != GLASS and (only is None or number in only)
            self._geoms[index].segid = number if shown else -1
        scene.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = scene.flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
        rectangle = self._draw_scene(size)
        scene.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = scene.flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 0
        cut_out = [(index, number) for index, number in self._cut_out if self._geoms[index].segid >= 0]
        if cut_out:
            self._draw_cut_out(cut_out, as_ids=True)
        if self._ids.shape[:2] != size:
            self._ids, self._raw_depth = np.empty((*size, 3), np.uint8), np.empty(size, np.float32)
        mujoco.mjr_readPixels(self._ids, self._raw_depth, rectangle, self._mjr)
        colours = self._ids[::-1].astype(np.int32)
        geom_id = (colours[..., 0] + (colours[..., 1] << 8) + (colours[..., 2] << 16)) - 1
        raw = self._raw_depth[::-1]
        depth_m = np.zeros(raw.shape, np.float32)
        hit = geom_id >= 0
        # Reversed depth: 1 at the near plane, 0 at the far one.
        depth_m[hit] = NEAR_M * FAR_M / (raw[hit].astype(float) * (FAR_M - NEAR_M) + NEAR_M)
        return geom_id, depth_m

    def _draw_scene(self, size: tuple[int, int]) -> mujoco.MjrRect:
        """Draws the scene with MuJoCo; returns the part of the buffer that holds the picture."""
        rectangle = mujoco.MjrRect(0, 0, size[1], size[0])
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._mjr)
        mujoco.mjr_render(rectangle, self._scene, self._mjr)
        return rectangle

    def _draw_colour(self, data, camera: Camera, scale: int) -> UInt8[np.ndarray, "h w 3"]:
        import cv2

        scene = self._scene
        level = self._meter.level(self._model, data)
        shadows = self._shadow_size > 0
        place_lights(self._model, data, scene, self._mjr, camera.camera_to_world, level, shadows=shadows)
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        size = scale * camera.size[0], scale * camera.size[1]
        rectangle = self._draw_scene(size)
        if self._cut_out:
            self._draw_cut_out(self._cut_out, as_ids=False)
        if self._rgb.shape[:2] != size:
            self._rgb, self._far = np.empty((*size, 3), np.uint8), np.empty(size, np.float32)
        mujoco.mjr_readPixels(self._rgb, self._far, rectangle, self._mjr)
        rgb = np.ascontiguousarray(self._rgb[::-1])
        if not self._has_skybox:
            self._add_sky(rgb, self._far[::-1] == 0.0, camera, scale)
        if scale > 1:
            rgb = cv2.resize(rgb, camera.size[::-1], interpolation=cv2.INTER_AREA)
        return rgb

    def _add_sky(self, rgb, empty: Bool[np.ndarray, "h w"], camera: Camera, scale: int) -> None:
        """Puts the sky of ``rays`` where nothing was drawn; glass before it keeps its own light."""
        rows, columns = np.nonzero(empty)
        if len(rows) == 0:
            return
        # Pixel (0, 0) of the larger picture is centred in the upper left part of pixel (0, 0).
        pixels = (np.stack([columns, rows, np.zeros_like(rows)], axis=1) + 0.5) / scale - [0.5, 0.5, 0.0]
        pixels[:, 2] = 1.0
        directions = pixels @ pixel_to_world(camera).T
        rgb[rows, columns] = np.maximum(rgb[rows, columns], sky_colour(directions, sky_of(self._model)[0]))

    def _draw_cut_out(self, geoms: list[tuple[int, int]], *, as_ids: bool) -> None:
        """Draws meshes whose textures have holes, and cloth, into the picture that MuJoCo has just drawn.

        Holes are left out, and so is the side of cloth that faces away. Neither casts nor gets shadows.

        MuJoCo leaves camera and lights in OpenGL's state, and its meshes and textures are OpenGL objects.
        """
        from OpenGL import GL

        GL.glPushAttrib(GL.GL_ALL_ATTRIB_BITS)
        GL.glEnable(GL.GL_DEPTH_TEST)
        GL.glCullFace(GL.GL_BACK)
        GL.glEnable(GL.GL_ALPHA_TEST)
        GL.glAlphaFunc(GL.GL_GEQUAL, HOLE_ALPHA)
        GL.glActiveTexture(GL.GL_TEXTURE0)
        if as_ids:
            # Colour from the geom, opacity from its texture.
            GL.glDisable(GL.GL_LIGHTING)
            GL.glTexEnvi(GL.GL_TEXTURE_ENV, GL.GL_TEXTURE_ENV_MODE, GL.GL_COMBINE)
            GL.glTexEnvi(GL.GL_TEXTURE_ENV, GL.GL_COMBINE_RGB, GL.GL_REPLACE)
            GL.glTexEnvi(GL.GL_TEXTURE_ENV, GL.GL_SRC0_RGB, GL.GL_PRIMARY_COLOR)
            GL.glTexEnvi(GL.GL_TEXTURE_ENV, GL.GL_COMBINE_ALPHA, GL.GL_REPLACE)
            GL.glTexEnvi(GL.GL_TEXTURE_ENV, GL.GL_SRC0_ALPHA, GL.GL_TEXTURE)
        else:
            GL.glEnable(GL.GL_LIGHTING)
            for light in range(min(self._scene.nlight, 8)):
                GL.glEnable(int(GL.GL_LIGHT0) + light)
        GL.glMatrixMode(GL.GL_MODELVIEW)
        for index, number in geoms:
            geom = self._geoms[index]
            if as_ids:
                GL.glColor4ub((number + 1) & 255, ((number + 1) >> 8) & 255, ((number + 1) >> 16) & 255, 255)
            else:
                GL.glColor4f(*(float(value) for value in geom.rgba))
                GL.glMaterialfv(GL.GL_FRONT_AND_BACK, GL.GL_EMISSION, (*(geom.emission * geom.rgba[:3]), 1.0))
                GL.glMaterialfv(GL.GL_FRONT_AND_BACK, GL.GL_SPECULAR, (geom.specular,) * 3 + (1.0,))
            (GL.glEnable if self._is_two_sided[number] else GL.glDisable)(GL.GL_CULL_FACE)
            texture = self._texture_of(geom)
            (GL.glEnable if texture >= 0 else GL.glDisable)(GL.GL_TEXTURE_2D)
            if texture >= 0:
                GL.glBindTexture(GL.GL_TEXTURE_2D, int(self._mjr.texture[texture]))
            pose = np.eye(4, dtype=np.float32)
            pose[:3, :3], pose[:3, 3] = geom.mat, geom.pos
            GL.glPushMatrix()
            GL.glMultMatrixf(pose.T.copy())
            GL.glCallList(self._mjr.baseMesh + geom.dataid)
            GL.glPopMatrix()
        GL.glPopAttrib()

    def _texture_of(self, geom: mujoco.MjvGeom) -> int:
        """-1 for none."""
        if geom.texid >= 0 or geom.matid < 0:
            return geom.texid
        roles = self._model.mat_texid.reshape(self._model.nmat, -1)[geom.matid]
        plain = int(roles[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)])
        return plain if plain >= 0 else int(roles[int(mujoco.mjtTextureRole.mjTEXROLE_RGBA)])


def _check(camera: Camera) -> None:
    check_camera(camera)
    if abs(camera.intrinsics[0, 1]) > 1e-9 * abs(camera.intrinsics[0, 0]) or np.any(camera.intrinsics[1:, 0] != 0):
        raise ValueError("the 'gl' renderer cannot draw sheared pixels: intrinsics must be [[fx 0 cx] [0 fy cy] ..]")


def _scene_options() -> mujoco.MjvOption:
    """Draw geoms of the visible groups and nothing else."""
    options = mujoco.MjvOption()
    for group in ("sitegroup", "jointgroup", "tendongroup", "actuatorgroup", "flexgroup", "skingroup"):
        getattr(options, group)[:] = 0
    options.flags[:] = 0
    for flag in (mujoco.mjtVisFlag.mjVIS_TEXTURE, mujoco.mjtVisFlag.mjVIS_STATIC):
        options.flags[flag] = 1
    return options
