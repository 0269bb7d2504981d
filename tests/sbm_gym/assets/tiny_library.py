"""A furniture library of one textured box, made on the spot."""

import io
import zipfile
from pathlib import Path

import cv2
import numpy as np

CATALOGUE = """\
# a comment
name=Tiny
license=CC0 1.0
id#1=Tiny#box
name#1=Bo\\u00eete \\
  en bois
category#1=Living room
model#1={model}
width#1=60.0
depth#1=40
height#1=90
creator#1=A. Maker
elevation#1=12
"""

# Corners of a box of 2 x 3 x 5 (x, y up, z to the front), its front face (z = 5) textured, the rest plain.
BOX = """\
mtllib box.mtl
v 0 0 0
v 2 0 0
v 2 3 0
v 0 3 0
v 0 0 5
v 2 0 5
v 2 3 5
v 0 3 5
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 1
usemtl front
f 5/1/1 6/2/1 7/3/1 8/4/1
usemtl rest
f 1 4 3 2
f -8 -4 -1 -5
f 2 3 7 6
f 1 2 6 5
f 4 8 7 3
"""

MATERIALS = """\
newmtl front
Kd 0.5 0.5 0.5
map_Kd {picture}
newmtl rest
Kd 0.2 0.4 0.6
d 0.5
"""


def picture(width: int = 8, height: int = 8) -> bytes:
    """A PNG whose upper half is red and whose lower half is blue."""
    image = np.zeros((height, width, 3), np.uint8)
    image[: height // 2, :, 2] = 255
    image[height // 2 :, :, 0] = 255
    return cv2.imencode(".png", image)[1].tobytes()


def write_library(
    path: Path,
    *,
    model: str = "/models/box.obj",
    catalogue: str = "",
    texture: str = "/Users/somebody/My pictures/wood.png",
    zipped: bool = False,
) -> Path:
    """Writes the library; ``catalogue`` is added to its catalogue, ``texture`` is what the MTL file asks for."""
    members = {
        "models/box.obj": BOX.encode(),
        "models/box.mtl": MATERIALS.format(picture=texture).encode(),
        "models/wood.png": picture(),
    }
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        text = CATALOGUE.format(model=model) + catalogue
        archive.writestr("PluginFurnitureCatalog.properties", text.encode("iso-8859-1"))
        archive.writestr("LICENSE.TXT", "Do what you like.")
        if zipped:
            inner = io.BytesIO()
            with zipfile.ZipFile(inner, "w") as nested:
                for name, content in members.items():
                    nested.writestr(name, content)
            archive.writestr("models/box.zip", inner.getvalue())
        else:
            for name, content in members.items():
                archive.writestr(name, content)
    return path
