"""``python -m studies.random_windows``: the study of random scenes."""

from studies.random_windows.study import main

if __name__ == "__main__":
    main()
