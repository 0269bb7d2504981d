"""View atlases: what a camera and a detector find at every place of a scene, looked up in place of being computed."""
