"""What is only drawn, kept beside a world's ``MjSpec``: to compile it takes a quarter of the time of a new scene.

Physics needs no meshes and pictures, and ``rays`` reads them from here. Whoever needs a model that holds them, as
OpenGL does, has them put into the spec.
"""

import hashlib
from dataclasses import dataclass, field

import mujoco
import numpy as np
from jaxtyping import UInt8

from sbm_gym.rendering.tables.looks import DrawnMesh, Looks, Picture


@dataclass
class LeftOut:
    """Meshes and pictures that a spec does without until it is made whole."""

    meshes: list[DrawnMesh] = field(default_factory=list)
    pictures: list[UInt8[np.ndarray, "h w c"]] = field(default_factory=list)
    """RGB or RGBA."""
    geoms: list[tuple[mujoco.MjsGeom, int]] = field(default_factory=list)
    """Geoms that show a mesh, and which; in the spec they are boxes around it."""
    materials: list[tuple[mujoco.MjsMaterial, int]] = field(default_factory=list)
    """Materials that show a picture, and which."""
    is_in_spec: bool = False
    """Whether nothing is left out any more."""

    def looks(self, model: mujoco.MjModel) -> Looks:
        """What the geoms and materials of a model show.

        Args:
            model: just compiled from the spec, which is not whole.
        """
        mesh_of_geom, texture_of_material = np.full(model.ngeom, -1), np.full(model.nmat, -1)
        for geom, mesh in self.geoms:
            mesh_of_geom[geom.id] = mesh
        for material, picture in self.materials:
            texture_of_material[material.id] = picture
        return Looks(self.meshes, mesh_of_geom, [Picture(one) for one in self.pictures], texture_of_material)

    def put_into(self, spec: mujoco.MjSpec) -> None:
        """Makes the spec whole."""
        if self.is_in_spec:
            return
        self.is_in_spec = True
        for number, mesh in enumerate(self.meshes):
            added = spec.add_mesh(name=_mesh_name(number))
            # Drawn only: a shell's inertia is defined for open and flat meshes too, and needs no convex hull.
            added.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            content = _mesh_file(mesh)
            # The name says what is in the file: whoever keeps meshes by name, as MuJoCo can, may keep these.
            added.file = f"{hashlib.blake2b(content, digest_size=16).hexdigest()}.msh"
            spec.assets[added.file] = content
        for number, picture in enumerate(self.pictures):
            texture = spec.add_texture(name=_texture_name(number), type=mujoco.mjtTexture.mjTEXTURE_2D)
            texture.height, texture.width, texture.nchannel = picture.shape
            texture.data = np.ascontiguousarray(picture).tobytes()
        for geom, mesh in self.geoms:
            geom.type, geom.meshname, geom.size = mujoco.mjtGeom.mjGEOM_MESH, _mesh_name(mesh), [0.0, 0.0, 0.0]
        roles = mujoco.mjtTextureRole
        for material, picture in self.materials:
            with_alpha = self.pictures[picture].shape[2] == 4
            material.textures[roles.mjTEXROLE_RGBA if with_alpha else roles.mjTEXROLE_RGB] = _texture_name(picture)


def _mesh_name(number: int) -> str:
    return f"mesh_{number}"


def _texture_name(number: int) -> str:
    return f"texture_{number}"


def _mesh_file(mesh: DrawnMesh) -> bytes:
    """A mesh with one normal (and texture coordinate) for each vertex as a file of MuJoCo's binary format.

    Source: MuJoCo, ``user_mesh.cc``, ``LoadMSH``: counts, then vertices, normals, texture coordinates and faces.
    """
    mapped = np.zeros((0, 2), np.float32) if mesh.texcoords is None else mesh.texcoords
    counts = np.array([len(mesh.vertices_m), len(mesh.normals), len(mapped), len(mesh.faces)], np.int32)
    return b"".join(column.tobytes() for column in (counts, mesh.vertices_m, mesh.normals, mapped, mesh.faces))
