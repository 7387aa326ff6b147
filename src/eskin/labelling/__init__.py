"""This package labels recordings: by their pressure, or by a person in the browser."""

from eskin.labelling.autolabel import (
    AutoLabelConfig,
    AutoLabelResult,
    LabelAgreement,
    label_automatically,
    label_recording,
)

__all__ = [
    "AutoLabelConfig",
    "AutoLabelResult",
    "LabelAgreement",
    "label_automatically",
    "label_recording",
]
