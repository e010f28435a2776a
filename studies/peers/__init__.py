"""polaropt against others' methods: their algorithms, the figures that papers print, and the study that compares."""
