"""``python -m studies.ablation_losses``: the ablation of the losses."""

from studies.ablation_losses.study import main

if __name__ == "__main__":
    main()
