__all__ = [
    "Pictures",
    "SampleStore",
    "TrainingJob",
    "store_samples",
    "train",
]

from .pictures import Pictures as Pictures
from .run import TrainingJob as TrainingJob
from .run import train as train
from .store import SampleStore as SampleStore
from .store import store_samples as store_samples
