"""Print the targets that tests run under: ``python tests/targets.py all``, or ``second``.

The second is the best one whose lanes are not those of the processor itself; nothing is printed where there is none.
"""

import sys

from dalembert.codegen.llvm.target import available_targets


def main(which: str) -> None:
    """Print the targets, one a line."""
    known = available_targets()
    others = [name for name, target in known.items() if target.lanes != known["native"].lanes]
    print("\n".join(known if which == "all" else others[-1:]))


if __name__ == "__main__":
    main(sys.argv[1])
