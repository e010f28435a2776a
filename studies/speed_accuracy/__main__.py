"""``python -m studies.speed_accuracy``: the study of seconds and accuracy."""

from studies.speed_accuracy.study import main

if __name__ == "__main__":
    main()
