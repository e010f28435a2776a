"""``python -m studies.benchmark``: the benchmark."""

from studies.benchmark.study import main

if __name__ == "__main__":
    main()
