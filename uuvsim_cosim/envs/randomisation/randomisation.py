"""Domain randomisation: parameters of a system that are drawn for every episode."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.randomisation.copula import Copula, copula_problems
from uuvsim_cosim.envs.randomisation.mass import hulls_of
from uuvsim_cosim.envs.randomisation.net_weight import net_weight_at_ends
from uuvsim_cosim.envs.randomisation.targets import Places, Quantity, Vary, resolved, varies
from uuvsim_cosim.envs.randomisation.yaml_text import read_declared
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.errors import InputInvalid, SystemInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["Randomisation", "Vary"]

Array = NDArray[np.float64]
Correlation = Mapping[tuple[str, str], float] | Sequence[Sequence[float]] | Array
TRIES = 100


@final
class Randomisation:
    """Distributions of parameters and their correlation, from which each episode draws.

    `parameters` are a list of `Vary`. `correlation` is that of the normal variables behind the
    draws (a Gaussian copula), so each parameter keeps its own distribution. It is a mapping from
    pairs of names to numbers in [-1, 1], or a matrix over `parameters`, each of which must then be
    one draw. Names are those of `labels`: "hull.m", "hull.D_l[1]", "thruster_3.T_n", or a pattern
    that is drawn together. Draws need a `system`; a task binds its randomisation to its own system.
    The sum of two randomisations draws the parameters of both. Raises SystemInvalid with every
    problem if the names or distributions do not fit the system, or if the ends of drawn masses are
    more than the vehicle's actuators carry, and InputInvalid for arguments of wrong types.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.envs import Draws, Randomisation, Uniform, Vary
    >>> drawn = Randomisation(
    ...     [Vary("hull.m", Uniform(12.5, 14.5)), Vary("hull.nabla", Uniform(0.0124, 0.0144))],
    ...     correlation={("hull.m", "hull.nabla"): 0.95},  # kg and m3: heavier hulls are larger
    ... )
    >>> bound = drawn.bound(uuv.load("bluerov2_task"))
    >>> bound.names, bound.labels
    (('hull.m', 'hull.nabla'), ('hull.m', 'hull.nabla'))
    >>> start = bound.draw(Draws(seeds=[0, 1], episodes=[0, 0]))
    >>> start["hull.m"].round(2)  # kg, one value for each of two episodes
    array([13.64, 12.92])
    >>> bound.privileged_names, bound.privileged_limits[1]  # for a critic
    (('hull.m', 'hull.nabla'), array([1., 1.]))
    >>> bound.privileged(start)[:, 0].round(2)  # -1 is 12.5 kg, 1 is 14.5 kg
    array([ 0.14, -0.58])
    """

    def __init__(
        self,
        parameters: Iterable[Vary],
        correlation: Correlation | None = None,
        system: System | None = None,
    ) -> None:
        self.parameters = varies(parameters)
        self.correlation = _pairs(correlation, self.parameters)
        self.system = system
        self.rejected: dict[str, int] = {}  # by hull: draws that were no possible body
        self.drawn = 0
        self._sinking: tuple[str, ...] = ()
        if system is None:
            return
        self._places = Places(system)
        self.quantities, problems = resolved(self._places, self.parameters)
        if not problems:
            problems = copula_problems(self.correlation, self.labels)
        if problems:
            raise SystemInvalid(problems)
        self._copula = Copula(self.correlation)
        self._hulls = list(hulls_of(self._places, self.names))
        self._sinking = net_weight_at_ends(self._places, self.quantities, self.correlation)

    def bound(self, system: System) -> Randomisation:
        """Return the same randomisation, bound to a `system`.

        Raises SystemInvalid with every problem if it does not fit.
        """
        same = self.system is system
        return self if same else Randomisation(self.parameters, self.correlation, system)

    def __add__(self, other: Randomisation) -> Randomisation:
        """Return both together."""
        pairs = {**self.correlation, **other.correlation}
        system = self.system if self.system is not None else other.system
        return Randomisation((*self.parameters, *other.parameters), pairs, system)

    @classmethod
    def read(cls, path: str | Path, system: System) -> Randomisation:
        """Read a YAML file of `parameters`, `sets` and `correlation`, and bind it to a `system`.

        `path` is the file; docs/systems/study_files.md describes it. Raises InputInvalid with every
        mistake and its line.

        Example:

        >>> from pathlib import Path
        >>> import uuvsim_cosim as uuv
        >>> from uuvsim_cosim.envs import Randomisation
        >>> text = "parameters: {hull.m: {uniform: [12.5, 14.5]}}"  # kg
        >>> _ = Path("mass.yaml").write_text(text)
        >>> Randomisation.read("mass.yaml", uuv.load("bluerov2_task")).names
        ('hull.m',)
        """
        return cls(*read_declared(Path(path), system), system)

    @property
    def labels(self) -> tuple[str, ...]:
        """The names of the draws; raises InputInvalid if there is no system."""
        self._bound()
        return tuple(q.label for q in self.quantities)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the variables that are drawn; raises InputInvalid if there is no system."""
        self._bound()
        return tuple(dict.fromkeys(t.name for q in self.quantities for t in q.targets))

    def draw(self, draws: Draws) -> Mapping[str, Array]:
        """Return start values by variable, of shape (n, *shape), for the n episodes of `draws`.

        A draw that is not a possible body (its mass matrix is not positive definite, or its moments
        of inertia violate the triangle inequality) is drawn again and counted in `rejected`. Raises
        InputInvalid after 100 such draws in a row, and if there is no system.
        """
        start = self._once(draws, "")
        self.drawn += draws.n
        for attempt in range(2, TRIES + 2):
            good = np.ones(draws.n, bool)
            for hull in self._hulls:
                right = hull.right(start, draws.n)
                if not right.all():
                    self.rejected[hull.path] = self.rejected.get(hull.path, 0) + int((~right).sum())
                good &= right
            if good.all():
                return start
            if attempt <= TRIES:
                for name, values in self._once(draws.rows(~good), f"/{attempt}").items():
                    start[name][~good] = values
        raise InputInvalid(
            ", ".join(h.path for h in self._hulls),
            f"{TRIES} draws one after the other gave no possible body (M not positive definite, "
            "or inertia against its triangle rule)",
            "distributions of mass and inertia that agree with each other",
        )

    @property
    def remarks(self) -> tuple[str, ...]:
        """Messages: masses that actuators do not carry, and draws that were no possible bodies.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> from uuvsim_cosim.envs import Draws, Randomisation, Uniform, Vary
        >>> inertia = [Vary("hull.I_b_33", Uniform(0.1, 1.0))]  # kg.m2, too wide on purpose
        >>> drawn = Randomisation(inertia, system=uuv.load("bluerov2_task"))
        >>> _ = drawn.draw(Draws(seeds=range(8), episodes=[0] * 8))
        >>> print(drawn.remarks[0])
        hull: ...
        """
        impossible = tuple(
            f"{path}: {count} draws beside the {self.drawn} used were no possible body (M not "
            "positive definite, or inertia against its triangle rule) and were drawn again"
            for path, count in self.rejected.items()
        )
        return (*self._sinking, *impossible)

    def _once(self, draws: Draws, attempt: str) -> dict[str, Array]:
        self._bound()
        u = {label: draws.uniform(f"randomisation/{label}{attempt}") for label in self.labels}
        return self._places.assembled(self.quantities, self._copula.correlated(u))

    # ---- privileged observations ----------------------------------------------------------

    @property
    def privileged_names(self) -> tuple[str, ...]:
        """The names of the numbers of `privileged`: those of the draws that are not constant."""
        self._bound()
        return tuple(q.label for q in self._seen)

    def privileged(self, start: Mapping[str, Array]) -> Array:
        """Return drawn values, each scaled by its range to [-1, 1], of shape (n, k).

        `start` are start values by variable, of shape (n, *shape), as `draw` returns them. A normal
        distribution without limits is scaled by three standard deviations and clipped. Raises
        InputInvalid for a variable that is missing in `start`.
        """
        self._bound()
        columns = []
        for q in self._seen:
            t, (low, high) = q.targets[0], q.limits
            if t.name not in start:
                raise InputInvalid(
                    t.name,
                    f"not among the start values {', '.join(start) or '(none)'}",
                    "the moment's `start`, of a task with this randomisation",
                )
            given = np.asarray(start[t.name], dtype=float)
            value = given.reshape(len(given), -1)[:, t.element]
            columns.append(np.clip(2.0 * (value - low) / (high - low) - 1.0, -1.0, 1.0))
        n = len(next(iter(start.values()))) if start else 0
        return np.stack(columns, axis=1) if columns else np.zeros((n, 0))

    @property
    def privileged_limits(self) -> tuple[Array, Array]:
        """The lower and upper limits of the numbers of `privileged`, -1 and 1, of shape (k,)."""
        k = len(self.privileged_names)
        return -np.ones(k), np.ones(k)

    @property
    def _seen(self) -> list[Quantity]:
        return [q for q in self.quantities if q.limits[0] < q.limits[1]]

    def _bound(self) -> None:
        if self.system is None:
            raise InputInvalid(
                "the randomisation belongs to no system yet",
                ".bound(system), or a task that it is given to",
            )


def _pairs(given: Correlation | None, parameters: tuple[Vary, ...]) -> dict[tuple[str, str], float]:
    if given is None:
        return {}
    if isinstance(given, Mapping):
        wrong = [key for key in given if not (isinstance(key, tuple) and len(key) == 2)]
        if wrong:
            raise InputInvalid("correlation", f"{wrong[0]!r}", "pairs of names")
        return {(str(a), str(b)): rho for (a, b), rho in given.items()}
    k = len(parameters)
    try:
        matrix = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        raise InputInvalid(
            "correlation", f"{given!r}", f"numbers by pairs of names, or a matrix {k} x {k}"
        ) from None
    if matrix.shape != (k, k) or not np.isfinite(matrix).all():
        raise InputInvalid(
            "correlation",
            f"numbers of shape {matrix.shape}",
            f"a finite matrix {k} x {k}, over the parameters",
        )
    if not np.array_equal(matrix, matrix.T) or not np.all(np.diag(matrix) == 1.0):
        raise InputInvalid("correlation: expected a symmetric matrix with ones on its diagonal")
    return {
        (parameters[i].name, parameters[j].name): float(matrix[i, j])
        for i in range(k)
        for j in range(i)
        if matrix[i, j] != 0.0
    }
