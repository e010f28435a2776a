__all__ = [
    "main",
]

from .start import main as main
