__all__ = [
    "KeptSamples",
    "Pictures",
    "TrainingJob",
    "keep_samples",
    "train",
]

from .kept import KeptSamples as KeptSamples
from .kept import keep_samples as keep_samples
from .pictures import Pictures as Pictures
from .run import TrainingJob as TrainingJob
from .run import train as train
