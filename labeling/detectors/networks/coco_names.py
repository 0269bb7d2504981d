"""COCO's names for things, and ours."""

OURS = {
    "potted plant": "plant",
    "refrigerator": "fridge",
    "dining table": "table",
}
"""Everything else has the same name in both."""


def our_names(coco: list[str]) -> tuple[str, ...]:
    """Names of the outputs 1, 2, ... of a network trained on COCO.

    Args:
        coco: its list, as torchvision has it: from 0, with "__background__" and "N/A" for outputs without a meaning.
    """
    return tuple("" if name == "N/A" else OURS.get(name, name) for name in coco[1:])
