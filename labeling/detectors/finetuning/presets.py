"""Named settings of fine-tuning: the best known, and the thesis'.

``python -m labeling.finetune --preset NAME`` starts from one of them; flags on the command line change single settings.
"""

from typing import Literal

from labeling.detectors.finetuning.config import FinetuneConfig

FinetunePreset = Literal["default", "paper"]

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

PRESETS: dict[FinetunePreset, FinetuneConfig] = {"default": FinetuneConfig(), "paper": PAPER}
