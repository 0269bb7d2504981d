"""Label sets in the formats of other tools: YOLO, FiftyOne, Hugging Face, OpenLABEL, masks as PNG, KITTI, glTF."""
