__all__ = [
    "BatchPanes",
    "BatchProblem",
    "Mosaic",
    "alike",
    "batch_problem",
    "minimize_batch",
    "observed_photographs",
    "observed_samples",
    "placed",
]

from .aliases import Mosaic as Mosaic
from .batch import placed as placed
from .observation import BatchPanes as BatchPanes
from .observation import observed_photographs as observed_photographs
from .observation import observed_samples as observed_samples
from .solve import BatchProblem as BatchProblem
from .solve import alike as alike
from .solve import batch_problem as batch_problem
from .solve import minimize_batch as minimize_batch
