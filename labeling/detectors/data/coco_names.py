"""COCO's categories, under the names that they have here."""

RENAMED = {"potted plant": "plant", "refrigerator": "fridge", "dining table": "table"}
"""Those that have another name here."""
_BY_ID = """
person,bicycle,car,motorcycle,airplane,bus,train,truck,boat,traffic light,fire hydrant,,stop sign,parking meter,bench,
bird,cat,dog,horse,sheep,cow,elephant,bear,zebra,giraffe,,backpack,umbrella,,,handbag,tie,suitcase,frisbee,skis,
snowboard,sports ball,kite,baseball bat,baseball glove,skateboard,surfboard,tennis racket,bottle,,wine glass,cup,fork,
knife,spoon,bowl,banana,apple,sandwich,orange,broccoli,carrot,hot dog,pizza,donut,cake,chair,couch,potted plant,bed,,
dining table,,,toilet,,tv,laptop,mouse,remote,keyboard,cell phone,microwave,oven,toaster,sink,refrigerator,,book,clock,
vase,scissors,teddy bear,hair drier,toothbrush
"""
COCO_90 = tuple(RENAMED.get(name, name) for name in _BY_ID.replace("\n", "").split(","))
"""By their ids, from 1; empty where no category has the id."""
COCO_80 = tuple(name for name in COCO_90 if name)
"""One after the other."""
