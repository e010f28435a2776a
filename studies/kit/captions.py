"""What each figure of a study shows, in a sentence for those who did not make it."""

from __future__ import annotations

CAPTIONS = {
    "ablation_losses": "PSNR and SSIM of both layers by networks that were trained without one term of the loss each.",
    "ablation_losses_crops": "The middle of one scene: both layers as each of these networks gives them.",
    "benchmark": "How far each solver's objective is from its minimum, over seconds.",
    "coverage": "Share of pixels within two stated standard errors of the truth, over incidence (95 % is meant).",
    "crops": "The middle of one scene: both layers as they come without each part of the separation.",
    "gained": "PSNR of both layers with each part of the separation less that without it.",
    "learned_init_paths": "How the layers' accuracy changes over the evaluations of a solve, from each start.",
    "learned_init_quality": "PSNR of both layers from each start against that from the closed form, over incidence.",
    "learned_init_work": "Evaluations and seconds that a solve takes from each start.",
    "mosaic": "PSNR of both layers from one raw mosaic over incidence, for each sensor, lens and way to separate.",
    "model_ladder": "PSNR of the transmission of families of scenes under each scene model; circled: the one chosen.",
    "paper_protocol": "PSNR of both layers over incidence: before any solve, with the scene known, and blind.",
    "parameter_errors": "How often the truth lies within two stated errors of the pane's numbers, and stated over "
    "true errors.",
    "peers": "PSNR of both layers over incidence, a line for each method.",
    "random_windows": "How many dB each random scene, found blind, is behind the same scene with the pane known.",
    "random_windows_errors": "Stated errors of the pane's numbers against true ones; on the line they agree.",
    "real_mosaics": "Layers of real raw mosaics: the middle of each capture as it was separated.",
    "shared_scene": "Errors of the pane's numbers that captures tell together, true and stated, over how many there "
    "are; grey: as the root of their number.",
    "sequences": "Frames per second of films by each camera, at the resolution of its cells or of its sensor.",
    "stability_map": "PSNR of both layers over incidence and noise; framed where a pair fails, dashed where that was "
    "not announced.",
    "stability_reflection": "PSNR of the reflection as scenes leave the plain case, for every method.",
    "stability_transmission": "PSNR of the transmission as scenes leave the plain case, for every method.",
    "stability_warnings": "Scenes of each family that fail, and which of them were announced by a warning.",
}
"""By the name of the figure's file."""
# The first that suits counts.
_BEGINNINGS = {
    "speed_one_at_a_time_mono": "Seconds against accuracy on raw mosaics of a mono sensor, one setting changed at a "
    "time.",
    "speed_one_at_a_time_color": "Seconds against accuracy on raw mosaics of a colour sensor, one setting changed at a "
    "time.",
    "speed_one_at_a_time": "Seconds against accuracy with one setting changed at a time; above all is best.",
    "speed_crossed_color": "Seconds against accuracy on raw mosaics of a colour sensor, settings changed together.",
    "speed_memory": "Memory beyond the photographs, one setting changed at a time.",
    "speed_profiles_mono": "Share of raw mosaics of a mono sensor that each setting solves within so many times the "
    "least seconds.",
    "speed_profiles_color": "Share of raw mosaics of a colour sensor that each setting solves within so many times the "
    "least seconds.",
    "speed_profiles": "Share of scenes that each setting solves within so many times the least seconds.",
    "speed_crossed": "Seconds against accuracy for settings changed together; above all is best.",
    "work_precision": "How far each solver is from the minimum of the objective, over seconds and evaluations.",
}


def caption(name: str) -> str:
    """What a figure shows, by its file's name without ending; the name itself where nothing is known of it."""
    beginnings = (words for start, words in _BEGINNINGS.items() if name.startswith(start))
    return CAPTIONS.get(name) or next(beginnings, name.replace("_", " "))
