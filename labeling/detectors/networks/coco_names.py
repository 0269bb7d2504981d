"""COCO's names for things, and ours."""

RENAMED = {
    "potted plant": "plant",
    "refrigerator": "fridge",
    "dining table": "table",
}
"""Everything else has the same name in both."""


def category_names_of_coco(coco: list[str]) -> tuple[str, ...]:
    """Names of the outputs 1, 2, ... of a network trained on COCO.

    Args:
        coco: its list, as torchvision has it: from 0, with "__background__" and "N/A" for outputs without a meaning.
    """
    return tuple("" if name == "N/A" else RENAMED.get(name, name) for name in coco[1:])
