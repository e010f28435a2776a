"""``python -m studies.peers``: the study of others' methods."""

from studies.peers.study import main

if __name__ == "__main__":
    main()
