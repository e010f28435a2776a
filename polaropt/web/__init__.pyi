__all__ = [
    "EXTRA",
    "serve",
]

from .server import EXTRA as EXTRA
from .server import serve as serve
