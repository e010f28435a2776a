__all__ = ["Solvable", "alike", "minimized", "solvable"]

from .solve import Solvable as Solvable
from .solve import alike as alike
from .solve import minimized as minimized
from .solve import solvable as solvable
