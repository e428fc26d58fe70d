"""Pages that simulate beside the export in C: sizes, and the time of a run as WebAssembly and as machine code.

``python benchmarks/pages.py`` prints; ``--save`` writes pages.csv, and a part of it to docs/export_measured.md. It
needs a C compiler, ziglang and Node.js.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

import exports
from export_kinds import changing
from exports import ATOL, CLOCK, LEAST, PROGRAM, ROOT, RTOL, Motion, compiled, method_of, motions, ran
from saved_tables import save

from export.pages import parts  # of the tests, whose folder `exports` makes known

sys.path.insert(0, str(ROOT / "docs"))

from live_pages import PAGES

TIMED = """
const fs = require("fs"), zlib = require("zlib");
const { code, given, span } = JSON.parse(fs.readFileSync(0, "utf8"));
const bytes = zlib.inflateRawSync(Buffer.from(code, "base64"));
const page = new WebAssembly.Instance(new WebAssembly.Module(bytes), {}).exports;
page._initialize();
new Float64Array(page.memory.buffer, page.page_given(), given.length).set(given);
let best = Infinity, all = 0;
for (let count = 0; all < LEAST || count < 100; count++) { // the first are interpreted
  const begin = performance.now();
  page.page_start(...span);
  while (page.page_status() < 0 && !page.page_reach(span[1], 1000));
  const spent = performance.now() - begin;
  best = Math.min(best, spent);
  all += spent;
}
console.log(page.page_status(), best / 1000);
"""


def further(quick: bool) -> Iterator[Motion]:
    """Yield motions with contacts, and the walker of the live pages, whose strikes are events."""
    yield from changing(quick)
    if not quick:
        live = PAGES["walker"]
        run = live.begin()
        yield Motion("compass walker", run.model, run.initial, run.parameters, live.end, tuple(run.events))


def row(motion: Motion, folder: Path) -> str:
    """Return the line of a motion."""
    given = {"initial": motion.initial, "parameters": motion.parameters, "events": motion.events}
    given |= {"t_span": (0, motion.end), "rtol": RTOL, "atol": ATOL}
    native = motion.model.export(folder / "export", **given)
    method, prefix = method_of(native), next(native.glob("*.h")).stem
    compiled(native, (CLOCK + PROGRAM).format(prefix, prefix.upper(), LEAST))
    own, steps = ran(motion, native)
    path = motion.model.export(folder / "a.html", "page", **given)
    described, codes = parts(path)
    asked = {"code": codes["run"], "given": [item["value"] for item in described["given"]], "span": described["span"]}
    program = TIMED.replace("LEAST", str(3000 * exports.LEAST))
    done = subprocess.run(["node", "-e", program], input=json.dumps(asked), capture_output=True, text=True, check=True)
    status, seconds = done.stdout.split()
    if status != "0":
        raise RuntimeError(f"{motion.name} ends with the status {status}")
    cells = (motion.name, method, len(steps), f"{1e6 * own:.0f}", f"{1e6 * float(seconds):.0f}")
    return "| " + " | ".join(map(str, (*cells, f"{path.stat().st_size / 1e3:.0f}"))) + " |"


def main() -> None:
    """Measure, and print or save the table."""
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("--save", action="store_true", help="write pages.csv, and docs/export_measured.md")
    reader.add_argument("--quick", action="store_true", help="two hard cases")
    options = reader.parse_args()
    warnings.simplefilter("ignore")
    lines = ["| motion | method | steps | C [us] | WebAssembly [us] | page [kB] |", "|---" * 6 + "|"]
    for motion in (*motions(options.quick), *further(options.quick)):
        with tempfile.TemporaryDirectory() as folder:
            lines.append(row(motion, Path(folder)))
        print(lines[-1], flush=True)
    if options.save:
        save("pages", "\n".join(lines))


if __name__ == "__main__":
    main()
