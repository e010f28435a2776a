__all__ = ["BatchProblem", "alike", "batch_problem", "minimize_batch"]

from .solve import BatchProblem as BatchProblem
from .solve import alike as alike
from .solve import batch_problem as batch_problem
from .solve import minimize_batch as minimize_batch
