"""What every study is built from: it runs jobs, keeps rows, and makes tables, charts and the page of results.

A study asks one question, and is one file: scenes x ways x scores. It has, in this order,

``Row``
    A frozen dataclass: the columns of its results, with their units. Plain values and tuples of them.
``run(job) -> list[Row]``
    One job's rows. A job is a frozen dataclass of plain values (most often a scene of `studies.scenes`, a pair of
    photographs and some ways of `studies.ways`), so that it has the same digest in every run and goes to other
    processes. What a way reaches is judged by `studies.scores`.
``tables(frame) -> str``
    All tables as Markdown, from the rows as a pandas DataFrame (`studies.kit.frames`).
``figures(frame) -> dict``
    A function for each figure, by the name of its files (`studies.kit.charts`).
``main(arguments)``
    The options, the jobs, then `studies.kit.run.run_study` and `studies.kit.run.publish`.

    >>> def main(arguments=None):
    ...     options = study_parser(__doc__).parse_args(arguments)
    ...     jobs = [Job(scene, pair, options.photos) for scene in LADDER for pair in range(n_pairs_of(options, 4))]
    ...     frame = run_study(NAME, run, jobs, Row, options)
    ...     publish(NAME, options, tables(frame), figures(frame))

A study of several subjects is a package: ``study.py`` has the five above, ``__main__.py`` calls its `main`.

A line in `studies.catalogue.STUDIES` makes it known to ``polaropt study``; a mark ``<!-- NAME/NAME.md -->`` in
``studies/README.md`` puts its tables on the page of results.
"""
