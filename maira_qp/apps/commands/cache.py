"""`maira-qp cache`: where the machine code of the kernels is kept."""

from __future__ import annotations

from dataclasses import dataclass

from maira_qp.apps.arguments.optional import Flag, explained


@explained
@dataclass(frozen=True, kw_only=True)
class Cache:
    """Show or clear the compiled code that is kept on this machine.

    What is missing is compiled again when it is needed; code older than the kernels' sources is never used."""

    clear: Flag = False
    """Remove it."""
    json: Flag = False
    """One JSON value on stdout."""

    def run(self) -> int:
        """Prints folder, files and bytes, in all and of the current sources; always 0."""
        from maira_qp.apps.arguments.output import console, print_json
        from maira_qp.kernels.jit import code_cache

        files, out = code_cache.kept(), console()
        size = sum(file.stat().st_size for file in files)
        if self.clear:
            code_cache.clear()
        current = [file for file in files if file.parent.name == code_cache.KEY]
        folders = list(map(str, code_cache.roots()))
        if self.json:
            told = {"folders": folders, "key": code_cache.KEY, "files": len(files), "bytes": size}
            print_json({**told, "current_files": len(current), "cleared": self.clear})
        elif self.clear:
            out.print(f"cleared {len(files)} files, {size / 1e6:.1f} MB, from {', '.join(folders)}", soft_wrap=True)
        else:
            out.print(f"{len(files)} files, {size / 1e6:.1f} MB, in {', '.join(folders)}", soft_wrap=True)
            out.print(f"{len(current)} of them are of the current sources and versions, key {code_cache.KEY}")
        return 0
