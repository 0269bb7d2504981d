"""Label sets in the formats of other tools: YOLO, masks as PNG, KITTI, glTF."""
