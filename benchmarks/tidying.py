"""Documents of `derive` for the shipped models, tidied by lagsim or by sympy.

    python -m benchmarks.tidying FOLDER [--trig] [MODEL ...]

Text and LaTeX are written to FOLDER/lagsim and FOLDER/sympy, to be read side by side;
processor times and costs (symbols, functions and operations in the equations, M and f)
are printed. sympy's way is `expand`, `collect` in velocities, accelerations and
multipliers, and `factor_terms`; with `--trig` also `futrig` and `TR10i`, which combine
products of sines and cosines. Each expression is replaced by the shortest of these
forms and its own. Results of 29 November 2026 are in `tidying.md`.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import sympy as sp
from sympy.simplify.fu import TR10i
from sympy.simplify.trigsimp import futrig

from benchmarks.pages import shipped
from lagsim.errors import InputError
from lagsim.mechanics.derivation import derive
from lagsim.model.reader import read_file
from lagsim.show import symbols
from lagsim.show.lagrange import derived
from lagsim.show.latex import as_latex
from lagsim.show.text import as_text
from lagsim.show.tidy import AS_IT_COMES, Tidier, written_size

# Longer expressions keep sines and cosines as they are: sympy needs minutes for them.
MOST_TURNED = 600


class SympyTidier(Tidier):
    """Tidier that simplifies by sympy's own functions."""

    trig = False

    def _shortest(self, e, *, factored, written):
        forms = [((1.0 if written else AS_IT_COMES) * written_size(e), e)]
        plain = sp.expand_mul(sp.expand_multinomial(e))
        found = {plain}
        if self.trig and e.has(sp.sin, sp.cos) and written_size(plain) < MOST_TURNED:
            found.add(sp.expand_mul(TR10i(futrig(plain))))
        for x in found:
            moving = sorted(x.free_symbols & self.moving, key=str)
            grouped = sp.collect(x, moving) if moving else x
            made = [grouped, sp.factor_terms(grouped)]
            made += [sp.factor_terms(x)] if factored else []
            forms += [(written_size(form), form) for form in made]
        return min(forms, key=lambda form: form[0])[1]

    def one_fraction(self, e):
        return sp.together(e)


def measured(path, tidier, folder):
    """Write the documents of a model; return the time and the cost, None if refused.

    tidier : class that simplifies.
    folder : where the documents are written.
    """
    symbols.Tidier = tidier
    equations = derive(read_file(str(path)))
    began = time.process_time()
    try:
        found = derived(equations)
    except InputError as error:
        print(f"{path.stem}: {error}")
        return None
    seconds = time.process_time() - began
    folder.mkdir(parents=True, exist_ok=True)
    for suffix, as_format in (("txt", as_text), ("tex", as_latex)):
        (folder / f"{path.stem}.{suffix}").write_text(as_format(found), "utf-8")
    d = found.document
    parts = [line[side] for line in d["equations"] for side in ("left", "right")]
    parts += [*d["f"], *(x for row in d["M"] for x in row)]
    return seconds, sum(map(written_size, parts))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--trig", action="store_true")
    parser.add_argument("models", nargs="*")
    asked = parser.parse_args()
    SympyTidier.trig = asked.trig
    for path in shipped():
        if path.stem in (asked.models or [path.stem]):
            both = [
                measured(path, tidier, asked.folder / name)
                for name, tidier in (("lagsim", Tidier), ("sympy", SympyTidier))
            ]
            print(path.stem, *both, flush=True)


if __name__ == "__main__":
    main()
