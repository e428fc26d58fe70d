"""Pages that simulate, taken apart: their description, and their simulator run in Node.js."""

import json
import re
import shutil
import subprocess
from importlib.util import find_spec

import numpy as np
import pytest

RUN = """
const fs = require("fs"), zlib = require("zlib");
const { code, given, span, times } = JSON.parse(fs.readFileSync(0, "utf8"));
const module_ = new WebAssembly.Module(zlib.inflateRawSync(Buffer.from(code, "base64")));
if (WebAssembly.Module.imports(module_).length) throw new Error("the module imports something");
const page = new WebAssembly.Instance(module_, {}).exports, rows = [];
page._initialize();
new Float64Array(page.memory.buffer, page.page_given(), given.length).set(given);
page.page_start(...span);
const row = new Float64Array(page.memory.buffer, page.page_row(), WIDTH);
for (const t of times) {
  while (page.page_status() <= 0 && !page.page_reach(t, 3));
  if (page.page_status() > 0) break;
  rows.push(Array.from(row));
}
const text = at => Buffer.from(page.memory.buffer, at).toString().split("\\0")[0];
const why = [text(page.page_status_text()), text(page.page_check_text())];
console.log(JSON.stringify({ status: page.page_status(), steps: page.page_steps(), rows, why }));
"""
"""A program that runs a simulator of a page to some times, a few steps a call, and prints the numbers there."""


def need_pages():
    """Skip a test where pages cannot be made."""
    if find_spec("ziglang") is None:
        pytest.skip("extra not installed")


def parts(path):
    """Return the description in a page, and its modules of WebAssembly, compressed."""
    text = path.read_text()
    description = json.loads(re.search(r"const MODEL = (.*);\n", text)[1])
    return description, dict(re.findall(r'(run|finer): "([^"]*)"', text))


def run_of(path, times, values=None, module="run"):
    """Run the simulator of a page; return what it prints, and its numbers by name."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no Node.js")
    described, codes = parts(path)
    given = [(values or {}).get(item["name"], item["value"]) for item in described["given"]]
    picture = described["picture"]
    first = described["energy"] + 2
    width = first + 3 * len(picture["points"]) + 9 * len(picture["framed"]) + picture["numbers"]
    asked = {"code": codes[module], "given": given, "span": described["span"], "times": [*map(float, times)]}
    program = RUN.replace("WIDTH", str(width))
    done = subprocess.run([node, "-e", program], input=json.dumps(asked), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:2000]
    found = json.loads(done.stdout)
    rows = np.array(found["rows"]).reshape(-1, width)
    names = [*described["variables"], *described["outputs"], "kinetic", "potential"]
    by_name = dict(zip(names, rows.T[: len(names)], strict=True))
    return found, {**by_name, "picture": rows[:, first:]}
