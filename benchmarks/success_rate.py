"""How often each method finds a pose, how exactly and how fast: `python benchmarks/success_rate.py`.

Two studies on MAIRA: every method on every kind of target, and the solver by every installed QP backend on random
targets. The summaries are written beside this script, the rows to `output/`; a run that was stopped goes on.
"""

from pathlib import Path

from rich.console import Console
from rich.progress import Progress

import maira_qp as mq
from maira_qp.apps import plots
from maira_qp.evaluation.records import write_csv
from maira_qp.evaluation.report import flat, legend, tables
from maira_qp.evaluation.runner import plan, run
from maira_qp.evaluation.settings import Settings
from maira_qp.evaluation.statistics import summarise
from maira_qp.io.atomic_write import replace_text
from maira_qp.problem.qp.backends import available

STUDIES = {
    "methods": Settings(targets=100),
    "backends": Settings(
        methods=("pose", "strict"), backends=("compiled", *available()), strata=("uniform",), targets=300
    ),
}
HERE = Path(__file__).parent

for name, settings in STUDIES.items():
    study = plan(mq.Robot.maira(), settings, mq.Options())
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(f"{name}: {study.rows} answers", total=study.rows)
        rows = run(
            study, f"output/benchmarks/{name}.jsonl", lambda done, task=task, bar=bar: bar.update(task, completed=done)
        )
    summaries = summarise(rows)
    console = Console(record=True, width=160, markup=False, highlight=False)
    for table in tables(summaries):
        console.print(table)
    console.print(legend(settings, mq.Options()))
    replace_text(HERE / f"success_rate_{name}.txt", console.export_text())
    write_csv(HERE / f"success_rate_{name}.csv", [flat(summary) for summary in summaries])
    plots.success_picture(summaries, HERE / f"success_rate_{name}.png")
