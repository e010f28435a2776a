__all__ = [
    "TrainingJob",
    "train",
]

from .run import TrainingJob as TrainingJob
from .run import train as train
