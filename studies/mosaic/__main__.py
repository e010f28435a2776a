"""``python -m studies.mosaic``: the study of raw mosaics."""

from studies.mosaic.study import main

if __name__ == "__main__":
    main()
