"""Small valid files as other programs write them: outlines drawn by hand, results of a detector, an exported network,
a furniture library.
"""

import json
import shutil
import zipfile
from pathlib import Path

import numpy as np

BOXES_PX = ((8.0, 12.0, 40.0, 52.0), (30.0, 6.0, 60.0, 30.0))
"""What the exported network finds in every picture: left, top, right, bottom."""
CATALOGUE = """\
name=Tiny
license=CC0 1.0
id#1=Blend Swap CC-0#chair
name#1=Chair
category#1=Living room
model#1=/models/chair.obj
width#1=60.0
depth#1=40
height#1=90
creator#1=Nobody
id#2=Blend Swap CC-0#oakTable
name#2=Table
category#2=Living room
model#2=/models/table.zip
width#2=120
depth#2=80
height#2=75
dropOnTopElevation#2=75
modelRotation#2=1 0 0 0 1 0 0 0 1
creator#2=Nobody
"""
OBJ = """\
mtllib model.mtl
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
MTL = """\
newmtl front
Kd 0.5 0.5 0.5
map_Kd wood.png
newmtl rest
Kd 0.2 0.4 0.6
d 0.5
"""


def make_outlines(out: Path, inputs: Path) -> None:
    """Episodes, an outline of one object in one view (``outlines.json``) and what a detector found (``results.json``),
    both in COCO's format with names of pictures.

    Args:
        out: the folder to fill.
        inputs: holds ``episodes``.
    """
    shutil.copytree(inputs / "episodes", out / "episodes")
    episode = out / "episodes" / "0000"
    frames = json.loads((episode / "transforms.json").read_text())["frames"]
    about = json.loads((episode / "episode.json").read_text())
    records = json.loads((episode / "detections.json").read_text())
    images = [{"id": number, "file_name": frame["file_path"]} for number, frame in enumerate(frames)]
    header = {"images": images, "categories": about["categories"]}
    found = [{"id": number, **record} for number, record in enumerate(records)]
    (out / "results.json").write_text(json.dumps({**header, "annotations": found}))
    surest = max(found, key=lambda record: record["score"])
    outline = {name: value for name, value in surest.items() if name != "score"}
    (out / "outlines.json").write_text(json.dumps({**header, "annotations": [outline]}))


def make_onnx(out: Path, inputs: Path) -> None:
    """An episode and ``model.onnx``, a network in YOLO's layout that finds the same in every picture.

    Args:
        out: the folder to fill.
        inputs: holds ``episodes``.
    """
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    shutil.copytree(inputs / "episodes" / "0000", out / "episode")
    boxes = np.array(BOXES_PX)
    rows = np.column_stack([(boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2], np.eye(2) * 0.9])
    value = rows.T[None].astype(np.float32)
    graph = helper.make_graph(
        [helper.make_node("Constant", [], ["output0"], value=numpy_helper.from_array(value))],
        "constant",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, (1, 3, 64, 64))],
        [helper.make_tensor_value_info("output0", TensorProto.FLOAT, value.shape)],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    helper.set_model_props(model, {"names": "{0: 'chair', 1: 'couch'}"})
    onnx.save(model, out / "model.onnx")


def make_furniture(out: Path, _: Path) -> None:
    """``library.sh3f``: a furniture library of two boxes, one of them in a zip of its own, with a texture.

    Args:
        out: the folder to fill.
    """
    import io

    import cv2

    wood = cv2.imencode(".png", np.full((8, 8, 3), 120, np.uint8))[1].tobytes()
    files = {"model.mtl": MTL.encode(), "wood.png": wood}
    nested = io.BytesIO()
    with zipfile.ZipFile(nested, "w", zipfile.ZIP_DEFLATED) as inner:
        for name, content in {"table.obj": OBJ.encode(), **files}.items():
            inner.writestr(name, content)
    with zipfile.ZipFile(out / "library.sh3f", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("PluginFurnitureCatalog.properties", CATALOGUE.encode("iso-8859-1"))
        archive.writestr("models/chair.obj", OBJ)
        for name, content in files.items():
            archive.writestr(f"models/{name}", content)
        archive.writestr("models/table.zip", nested.getvalue())
