"""The meshes and pictures that a model shows: its own, or those that it was compiled without."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float32, Int, Int32, UInt8


@dataclass(frozen=True)
class DrawnMesh:
    """A triangle mesh in the frame of the geoms that show it, metres."""

    vertices_m: Float32[np.ndarray, "v 3"]
    faces: Int32[np.ndarray, "t 3"]
    normals: Float32[np.ndarray, "n 3"]
    normals_of_faces: Int32[np.ndarray, "t 3"]
    """Which normal each corner of a triangle has."""
    texcoords: Float32[np.ndarray, "m 2"] | None
    """(u, v) with v downwards from the top row of the picture; None where the mesh has none."""
    texcoords_of_faces: Int32[np.ndarray, "t 3"] | None


@dataclass(frozen=True)
class Picture:
    """What a texture shows."""

    texels: UInt8[np.ndarray, "h w c"]
    """Row 0 on top; faces of a cube stand below each other, or are all the same square."""
    is_cube: bool = False
    is_linear: bool = False
    """Whether bytes are linear light; else they are sRGB."""


@dataclass(frozen=True)
class Looks:
    """What geoms and materials of a compiled model show."""

    meshes: Sequence[DrawnMesh]
    mesh_of_geom: Int[np.ndarray, "ngeom"]
    """-1 for geoms of other types."""
    pictures: Sequence[Picture]
    texture_of_material: Int[np.ndarray, "nmat"]
    """Which picture covers a material, -1 for none."""

    @classmethod
    def of_model(cls, model: mujoco.MjModel) -> "Looks":
        """The meshes and textures that a model holds."""
        types = mujoco.mjtGeom
        is_mesh = np.isin(model.geom_type, (int(types.mjGEOM_MESH), int(types.mjGEOM_SDF)))
        roles = model.mat_texid.reshape(model.nmat, int(mujoco.mjtTextureRole.mjNTEXROLE))
        plain, with_alpha = (roles[:, int(getattr(mujoco.mjtTextureRole, f"mjTEXROLE_{r}"))] for r in ("RGB", "RGBA"))
        return cls(
            [_mesh(model, mesh) for mesh in range(model.nmesh)],
            np.where(is_mesh, model.geom_dataid, -1),
            [_picture(model, texture) for texture in range(model.ntex)],
            np.where(plain >= 0, plain, with_alpha),
        )


def _mesh(model: mujoco.MjModel, mesh: int) -> DrawnMesh:
    faces = slice(int(model.mesh_faceadr[mesh]), int(model.mesh_faceadr[mesh] + model.mesh_facenum[mesh]))
    coordinates_at = int(model.mesh_texcoordadr[mesh])
    has_coordinates = coordinates_at >= 0
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    return DrawnMesh(
        model.mesh_vert[first : first + count],
        model.mesh_face[faces],
        model.mesh_normal[model.mesh_normaladr[mesh] :],
        model.mesh_facenormal[faces],
        model.mesh_texcoord[coordinates_at:] if has_coordinates else None,
        model.mesh_facetexcoord[faces] if has_coordinates else None,
    )


def _picture(model: mujoco.MjModel, texture: int) -> Picture:
    height, width, channels = (int(getattr(model, f"tex_{name}")[texture]) for name in ("height", "width", "nchannel"))
    start = int(model.tex_adr[texture])
    texels = np.asarray(model.tex_data[start : start + height * width * channels], np.uint8)
    return Picture(
        texels.reshape(height, width, channels),
        # Counts of channels that are no picture's are taken for one white texel.
        1 <= channels <= 4 and bool(model.tex_type[texture] != mujoco.mjtTexture.mjTEXTURE_2D),
        bool(model.tex_colorspace[texture] == mujoco.mjtColorSpace.mjCOLORSPACE_LINEAR),
    )
