"""`maira-qp doctor`: what is installed here, and whether it works."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from maira_qp.apps.arguments.optional import Flag, explained
from maira_qp.apps.left_pipes import reader_may_leave

if TYPE_CHECKING:
    from maira_qp.apps.doctor import Finding

SICK = 1


@explained
@dataclass(frozen=True, kw_only=True)
class Doctor:
    """Check this installation, and solve a pose.

    Versions, QP backends, extras, and the cache of compiled code are looked at. Exit code 0: all is well, 1: something
    is not; what is optional may be absent."""

    json: Flag = False
    """One JSON value on stdout."""

    def run(self) -> int:
        """Prints the findings; the exit code as the class says."""
        from maira_qp.apps.doctor import State, examine

        findings = list(examine())
        faults = [finding for finding in findings if finding.state is State.FAULT]
        with reader_may_leave():
            self._tell(findings, faults)
        return SICK if faults else 0

    def _tell(self, findings: list[Finding], faults: list[Finding]) -> None:
        from maira_qp.apps.arguments.output import print_json

        if self.json:
            rows = [{**asdict(finding), "state": finding.state.value} for finding in findings]
            print_json({"well": not faults, "findings": rows})
        else:
            _show(findings, faults)


def _show(findings: list[Finding], faults: list[Finding]) -> None:
    """The findings as a table on stdout."""
    from rich.table import Table
    from rich.text import Text

    from maira_qp.apps.arguments.output import console
    from maira_qp.apps.doctor import State

    colors = {State.WELL: "green", State.ABSENT: "dim", State.FAULT: "bold red"}
    table = Table()
    for name in ("", "what", "state", "seen"):
        table.add_column(name, overflow="fold")
    group = ""
    for finding in findings:
        if group and finding.group != group:
            table.add_section()
        lines = "\n".join(line for line in (finding.told, finding.advice) if line)
        shown = finding.group if finding.group != group else ""
        table.add_row(shown, finding.name, Text(finding.state.value, colors[finding.state]), lines)
        group = finding.group
    out = console()
    out.print(table)
    if not faults:
        out.print("all is well", style="bold green")
    for fault in faults:
        out.print(f"{fault.name}: {fault.told}; {fault.advice}", style="bold red")
