"""Trials: runs of one model with other values and settings, the basis of all studies.

A study compares runs of a model: at other values of parameters and of the start, at
another tolerance or step, by another method. `Variant` describes such a run by its
differences from the file, `Trials` makes the runs, and `Trial` is the result of one.
Nothing is read, derived or compiled anew for a variant, as far as possible. An
inadmissible start, a value out of range and a run that fails are results, too, not
exceptions. Trials can be pickled, for other processes.

A trial is one integration without error bar and audit, see `attempts` for these.

Examples
--------
The derivative of a motion by a parameter, from two runs:

>>> import numpy as np
>>> from lagsim.model.reader import read
>>> model = read('''
... parameters: {k: 4}
... coordinates: {x: {}}
... energy: {kinetic: x_dot^2/2, potential: k*x^2/2}
... initial: {x: 1}
... simulation: {duration: 1}
... ''', "<model>")
>>> trials = Trials(model, {"rtol": 1e-13})
>>> times = np.array([0.25, 0.5, 1.0])
>>> below, above = (trials.run(Variant({"k": k}, times=times)) for k in (3.99, 4.01))
>>> np.round((above.column("x") - below.column("x")) / 0.02, 4)
array([-0.03  , -0.1052, -0.2273])
>>> trials.run(Variant({"k": "1/0"})).outcome
'unusable'
"""

from __future__ import annotations

import functools
import pickle
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

from lagsim.errors import LagsimError
from lagsim.mechanics.reduction import equations_of_motion
from lagsim.run.session import examined, settings_of, suited
from lagsim.studies.trial import Compiled, refused_trial, tried

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Session
    from lagsim.studies.trial import Trial

    # Values of names as expressions; the pickled model, options and the command.
    Texts = Mapping[str, str]
    Key = tuple[bytes, tuple[tuple[str, float | str], ...], str]

# The largest number of compiled forms of a model; the least recently used is dropped.
MOST_FORMS = 16


class Variant(NamedTuple):
    """A run of a study, by its differences from the run of the file.

    Attributes
    ----------
    values : mapping of str to float or str
        Parameters and start values that are replaced: numbers or expressions.
    settings : mapping of str to object
        Fields of `lagsim.model.model.Settings` that are replaced after the options of
        all trials, such as `rtol`, `method`, `formulation`, `step` or `output_step`.
        For differences of runs, give the `method` and the `formulation` that
        `Trials.session().plan` has: `auto` may choose others for other values.
    times : ndarray, shape (k,), or None
        Times of the rows, in any order, by the dense output of the method: the steps
        are those of the run without these times. None for the rows of the run: all
        output times and both rows of each impact.
    guesses : collection of str
        Start values that are solved for from the constraints, as if the file marked
        these as guesses, so that another start value can be varied.
    """

    values: Mapping[str, float | str] = {}
    settings: Mapping[str, Any] = {}
    times: Floats | None = None
    guesses: Collection[str] = ()


# The run of the file.
STATED = Variant()


class Form:
    """Equations of a model for some structure, with the sessions compiled for these.

    Parameters
    ----------
    texts : mapping of str to str
        Expressions of values by name.
    options, caller
        See `Forms`.

    Attributes
    ----------
    structure : dict of str to str
        The structure: values on which ranges and subscripts of the file depend.
    equations : Equations
    """

    def __init__(
        self,
        model: Model,
        texts: Texts,
        options: Mapping[str, float | str],
        caller: str,
    ) -> None:
        # With other values, the form of the equations may depend on other names: on a
        # parameter of an axis, for example, that is 0 in the file and not here.
        self.structure: dict[str, str] = {}
        while (found := structural_values(model, texts)) != self.structure:
            model, self.structure = model.bind(**found), found
        self.model = suited(model, settings_of(model, caller, options))
        self.equations = equations_of_motion(self.model, gathers=True)
        self._options, self._caller = options, caller
        self.compiled = Compiled()
        self._tried: list[Mapping[str, Any]] = []

    def session(
        self, texts: Texts, settings: Mapping[str, Any], guesses: Collection[str]
    ) -> Session | None:
        """Return the session of a variant; None if the variant needs another form.

        texts : expressions of values by name.
        settings, guesses : see `Variant`.

        Raises
        ------
        InputError, StartError
            If a value cannot be used, or the start is not admissible.
        """
        if structural_values(self.model, texts) != self.structure:
            return None
        model = self.model.bind(**texts)
        if guesses:
            initial = (
                x._replace(guess=x.guess or x.name in guesses) for x in model.initial
            )
            model = replace(model, initial=tuple(initial))
        given = settings_of(model, self._caller, self._options)._replace(**settings)
        case = examined(self.equations, model, given)
        plan = case.plan()
        found = self.compiled.fitting(case, plan)
        if found is None and settings not in self._tried:
            self._tried.append(settings)
            found = self.compiled.compile(case, plan)
        return found


def structural_values(model: Model, texts: Texts) -> dict[str, str]:
    """Select the values on which ranges and subscripts of the file depend.

    texts : expressions of values by name.
    """
    names = model.stated.structural()
    return {name: text for name, text in texts.items() if name in names}


class Forms:
    """Sessions of a model for any values, each compiled once.

    The functions compiled for the first variant serve all variants that they fit, with
    results equal in every bit to those of a separate run. If values need other
    functions (because another method suits these values, for example), the model is
    read again, and its functions serve later runs, too. Other settings alone need no
    second reading.

    Parameters
    ----------
    model : bytes
        The pickled Model.
    options : mapping of str to float or str
        Options of all runs, as of `lagsim run`.
    caller : str
        The name of the command, for messages.
    """

    def __init__(
        self, model: bytes, options: Mapping[str, float | str], caller: str
    ) -> None:
        self._model, self._options, self._caller = model, options, caller
        self.known: list[Form] = []

    def form(self, texts: Texts) -> Form:
        """Return a new form of the equations for some values, without sessions.

        texts : expressions of values by name.
        """
        return Form(pickle.loads(self._model), texts, self._options, self._caller)

    def session(
        self,
        texts: Texts,
        settings: Mapping[str, Any] = STATED.settings,
        guesses: Collection[str] = (),
    ) -> Session:
        """Return the session of a variant, compiled if no earlier functions fit.

        texts : expressions of values by name.
        settings, guesses : see `Variant`.

        Raises
        ------
        InputError, StartError
            If a value cannot be used, or the start is not admissible.
        """
        for k, form in enumerate(self.known):
            session = form.session(texts, settings, guesses)
            if session is not None:
                self.known.insert(0, self.known.pop(k))
                return session
        new = self.form(texts)
        self.known = [new, *self.known[: MOST_FORMS - 1]]
        session = new.session(texts, settings, guesses)
        assert session is not None
        return session


class Trials:
    """Runs of one model in any number of variants.

    Parameters
    ----------
    model : Model
    options : mapping of str to float or str, optional
        Options of all runs, as of `lagsim run`: `rtol`, `method`, `duration` ...
    caller : str
        The name of the command, for messages on a model that cannot be run.
    """

    def __init__(
        self,
        model: Model,
        options: Mapping[str, float | str] | None = None,
        caller: str = "run",
    ) -> None:
        content, known = pickle.dumps(model), {**(options or {})}
        self._key: Key = content, tuple(known.items()), caller
        self._forms = Forms(content, known, caller)

    def __reduce__(self) -> tuple[Callable[..., Trials], Key]:
        return _again, self._key

    def session(self, variant: Variant = STATED) -> Session:
        """Return the session of a variant, which can be run any number of times.

        Raises
        ------
        InputError, StartError
            If a value or a setting cannot be used, or the start is not admissible.
        """
        texts = {
            name: x if isinstance(x, str) else repr(float(x))
            for name, x in variant.values.items()
        }
        return self._forms.session(texts, variant.settings, variant.guesses)

    def run(
        self, variant: Variant = STATED, *, interrupt: Interrupt | None = None
    ) -> Trial:
        """Return the result of a variant; no LagsimError is raised.

        interrupt : as for `tried`.
        """
        try:
            session = self.session(variant)
        except LagsimError as error:
            return refused_trial(error)
        return tried(session, variant.times, interrupt=interrupt)


@functools.lru_cache(maxsize=2)
def _again(
    content: bytes, options: tuple[tuple[str, float | str], ...], caller: str
) -> Trials:
    """Return the trials of a pickle, with the sessions compiled in this process.

    content : the pickled Model.
    options, caller : see `Trials`.
    """
    return Trials(pickle.loads(content), dict(options), caller)
