"""Named settings of fine-tuning: the best known, those for categories that a detector has no name for, and the thesis'.

``python -m labeling.finetune --preset NAME`` starts from one of them; flags on the command line change single settings.
"""

from typing import Literal

from labeling.detectors.finetuning.config import FinetuneConfig

FinetunePreset = Literal["default", "new-categories", "paper"]

NEW_CATEGORIES = FinetuneConfig(iterations=1440, learning_rate=6e-4, replay_share=0.3)
"""Getting to know categories takes more than getting better at those that one knows. Chosen in homes that decisions are
made in (docs/design-notes.md, "Longer training, more homes")."""
PAPER = FinetuneConfig(
    iterations=4000,
    batch_size=2,
    learning_rate=1e-3,
    validate_every=500,
    optimizer="sgd",
    weight_decay=1e-4,
    schedule="constant",
    warmup=200,
    frozen_stages=0,
    average=0.0,
    interpolate=1.0,
    repeat_threshold=0.0,
)
"""Learning rate and size of batches are those of thesis 5.1.3; the rest, which it does not tell, is usual for such
networks."""

PRESETS: dict[FinetunePreset, FinetuneConfig] = {
    "default": FinetuneConfig(),
    "new-categories": NEW_CATEGORIES,
    "paper": PAPER,
}
