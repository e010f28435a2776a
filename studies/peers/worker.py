"""Run fast-reflection-removal in an environment of its own: ``python worker.py IMAGE.npy OUT.npy STRENGTH...``.

Reads an image (h, w, channel) in [0, 1] and writes its transmissions, one for each strength. It needs numpy < 2, so
this file imports nothing of polaropt.
"""

import sys

import numpy as np


def main() -> None:
    """Read, run for each strength, write."""
    from frr import FastReflectionRemoval

    source, target, *strengths = sys.argv[1:]
    image = np.load(source)
    np.save(target, np.stack([FastReflectionRemoval(h=float(h)).remove_reflection(image) for h in strengths]))


if __name__ == "__main__":
    main()
