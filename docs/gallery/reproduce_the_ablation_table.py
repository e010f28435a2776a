"""
Reproduce the ablation table
============================

What is each part of the separation worth? ``polaropt study ablation`` takes one part away at a time. Here the
study's own functions do it for two incidences and one pair of photographs, at 96x96 px: small and quick, so that
its figures tell less than those of the full run, which stand in :doc:`/results`. The learned start is no part of the
separation: there it is put in. It needs the extra ``studies``, and for that row ``torch``.
"""

from dataclasses import asdict

import matplotlib.pyplot as plt
from pandas import DataFrame

from studies import ablation
from studies.camera import SceneJob
from studies.scenes import protocol

# %%
# One job is a scene, separated without each part. The command for all of them is
# ``polaropt study ablation --full --workers 0 -o OUT``.

INCIDENCES_DEG = (10, 60)
jobs = [SceneJob(protocol(incidence), 0, None, 96) for incidence in INCIDENCES_DEG]
rows = DataFrame([asdict(row) for job in jobs for row in ablation.rows_of_parts(job)])

# %%
# The table
# ---------
# PSNR in dB. Two scenes give no interval; a difference below about 0.1 dB is none here.

table = rows.groupby("variant", sort=False)[["transmission", "reflection", "evaluations"]].mean().dropna()
for layer in ("transmission", "reflection"):
    table[f"{layer} lost"] = table[layer].iloc[0] - table[layer]
table.round(2)

# %%
# As a chart: what is lost without each part, and what the learned start loses (less than nothing: it gains).

lost = table[["transmission lost", "reflection lost"]].iloc[1:][::-1]
axis = lost.plot.barh(figsize=(8, 6), color=["tab:blue", "tab:orange"])
axis.set(xlabel="dB lost", ylabel="", title="Without each part, mean of 10 and 60 degrees")
axis.axvline(0, color="grey", linewidth=0.8)
plt.tight_layout()
