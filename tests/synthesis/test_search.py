"""pymoo drives the search: its generations, what is ours in it, what it is given."""

import re

import numpy as np
import pytest
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.algorithms.moo.nsga3 import NSGA3
from pymoo.algorithms.moo.sms import SMSEMOA
from pymoo.algorithms.moo.spea2 import SPEA2
from pymoo.algorithms.soo.nonconvex.cmaes import CMAES
from pymoo.algorithms.soo.nonconvex.de import DE
from pymoo.core.evaluator import Evaluator
from pymoo.core.population import Population
from pymoo.core.problem import Problem
from pymoo.functions import FunctionLoader
from pymoo.operators.crossover.sbx import SBX, cross_sbx
from pymoo.operators.mutation.pm import PM, mut_pm
from pymoo.problems.static import StaticProblem

from pmopt.numerics.elementary import power_of
from pmopt.synthesis.config import AlgorithmSettings
from pmopt.synthesis.operators import crossed, mutated
from pmopt.synthesis.search import SameBits, Search, nsga2

LOWER, UPPER = np.zeros(3), np.array([1.0, 1.0, 2.0])
SETTINGS = {"crossover_eta": 15.0, "crossover_probability": 0.8, "mutation_eta": 25.0}


def space(objectives, constraints=2):
    return Problem(n_var=3, n_obj=objectives, n_ieq_constr=constraints, xl=LOWER, xu=UPPER)


def measured(variables, objectives, ties=False):
    x, y, z = variables.T
    values = np.stack([x + 0.3 * y**2, (1 - x) ** 2 + 0.2 * z, y - x * z], axis=1)[:, :objectives]
    excess = np.stack([0.3 - x * y, z - 0.8], axis=1)
    if ties:
        return np.round(values, 1), np.where(excess > 0, 1.0, excess)
    return values, excess


def plain(size):
    """Return pymoo's own algorithm with the same settings."""
    return NSGA2(pop_size=size, crossover=SBX(eta=15.0, prob=0.8), mutation=PM(eta=25.0))


def ours(size):
    return nsga2(AlgorithmSettings(population=size, **SETTINGS))


def searched(algorithm, generations, objectives=2, ties=False, seed=5):
    """Run an algorithm and return the search."""
    search = Search(algorithm, space(objectives), seed)
    for _ in range(generations):
        variables = search.ask()
        search.tell(variables, *measured(variables, objectives, ties))
    return search


@pytest.mark.parametrize("size", [4, 21, 40])
@pytest.mark.parametrize("objectives", [2, 3])
@pytest.mark.parametrize("ties", [False, True])
def test_generations_are_those_of_plain_pymoo(size, objectives, ties, monkeypatch):
    """Design for design, where pymoo has our powers and stable sorts, driven as it documents."""
    theirs = plain(size).setup(space(objectives), termination=("n_gen", 15), seed=size)
    sort = np.argsort
    monkeypatch.setattr(np, "argsort", lambda a, **more: sort(a, **more | {"kind": "stable"}))
    monkeypatch.setattr(np, "power", lambda x, n: power_of(x, n.flat[0]) if len(n) else x)
    search = Search(ours(size), space(objectives), size)
    for _ in range(15):
        asked, variables = theirs.ask(), search.ask()
        assert (asked.get("X") == variables).all()
        values, excess = measured(variables, objectives, ties)
        Evaluator().eval(StaticProblem(space(objectives), F=values, G=excess), asked)
        theirs.tell(infills=asked)
        search.tell(variables, values, excess)
        for name in ("X", "F", "CV"):
            assert (theirs.pop.get(name) == search.algorithm.pop.get(name)).all()
        state = theirs.random_state.bit_generator.state
        assert search.generator == state


def test_operators_are_those_of_pymoo_to_rounding():
    lower, upper = np.array([0.0, -1.0, 2.0, 1.0]), np.array([1.0, 3.0, 2.0, 1e3])
    parents = lower + (upper - lower) * np.random.default_rng(1).random((2, 500, 4))
    for eta in (0.5, 15.0, 20.0, 300.0):
        full = np.full((500, 1), eta)
        theirs = cross_sbx(
            parents, lower, upper, full, np.full_like(full, 0.5), np.full_like(full, 0.4),
            random_state=np.random.default_rng(2),
        )  # fmt: skip
        own = crossed(parents, lower, upper, eta, 0.5, 0.4, np.random.default_rng(2))
        assert (own != parents).any()
        np.testing.assert_allclose(own, theirs, rtol=1e-13, atol=1e-14)
        theirs = mut_pm(parents[0], lower, upper, full[:, 0], np.full(500, 0.3),
                        at_least_once=False, random_state=np.random.default_rng(3))  # fmt: skip
        own = mutated(parents[0], lower, upper, eta, 0.3, np.random.default_rng(3))
        assert (own != parents[0]).any()
        np.testing.assert_allclose(own, theirs, rtol=1e-13, atol=1e-14)


# --- the same on every processor ----------------------------------------------------------

#: Functions of NumPy whose last bits depend on the processor.
LIBRARY = re.compile(
    r"a?(sin|cos|tan)h?|arc\w+|exp\w*|log(2|10|1p|addexp2?)?|pow\w*|float_power|cbrt|"
    r"dot|vdot|inner|matmul|tensordot|einsum"
)
#: Sorts that keep the order of what is equal.
STEADY = ("stable", "mergesort")


def refuse(monkeypatch):
    """Let fail what a processor decides: such functions, the order of what is equal."""

    def refused(*_, **__):
        raise AssertionError("depends on the processor")

    sort, order = np.sort, np.argsort

    def ordering(a, axis=-1, kind=None, **more):
        own = getattr(type(a), "argsort", None) not in (None, np.ndarray.argsort)
        ascending = np.moveaxis(sort(a, axis=axis, kind="stable"), axis, 0)
        if (ascending[1:] == ascending[:-1]).any() and kind not in STEADY and not own:
            refused()
        return order(a, axis=axis, kind=kind, **more)

    for name in filter(LIBRARY.fullmatch, dir(np)):
        monkeypatch.setattr(np, name, refused)
    monkeypatch.setattr(np, "argsort", ordering)
    monkeypatch.setattr("pymoo.core.duplicate.cdist", refused)


@pytest.mark.parametrize("ties", [False, True])
@pytest.mark.parametrize("objectives", [2, 3])
def test_no_processor_decides(objectives, ties, monkeypatch):
    refuse(monkeypatch)
    search = searched(ours(21), 12, objectives, ties)
    designs = search.algorithm.pop
    search.replace(*designs.get("X", "F", "G"))
    search.ask()


@pytest.mark.parametrize("part", ["crossover", "mutation", "survival", "eliminate_duplicates"])
def test_processors_would_decide_in_plain_pymoo(part, monkeypatch):
    """Each of the parts that are handed in is needed."""
    algorithm, theirs = ours(21), plain(21)
    for holder in ("mating", "initialization", None):
        mine, other = (getattr(a, holder) if holder else a for a in (algorithm, theirs))
        if hasattr(mine, part):
            setattr(mine, part, getattr(other, part))
    refuse(monkeypatch)
    with pytest.raises(AssertionError, match="depends on the processor"):
        searched(algorithm, 12, ties=True)


@pytest.mark.parametrize("size", [1e-20, 1.0, 1e9])
def test_designs_that_differ_in_a_bit_are_two(size):
    first = np.array([1.0, 2.0]) * size
    designs = [first, np.nextafter(first, 0), first, 3 * first]
    kept = SameBits().do(Population.new("X", np.array(designs)))
    assert (kept.get("X") == np.array([designs[k] for k in (0, 1, 3)])).all()
    others = Population.new("X", np.array(designs[1:2]))
    assert (SameBits().do(kept, others).get("X") == np.array([designs[k] for k in (0, 3)])).all()


# --- what it is given ---------------------------------------------------------------------


def test_recorded_designs_are_taken_as_they_are():
    """Fewer, more, others than asked for, or where nothing is asked for any more."""
    search = searched(ours(12), 3)
    rng = np.random.default_rng(2)
    for count in (12, 5, 30):
        search.ask()
        others = np.array([0.9, 0.5, 0.1]) + 0.1 * rng.random((count, 3))
        before = search.algorithm.pop.get("X")
        rows = search.tell(others, *measured(others, 2))
        survivors = np.concatenate([before, others])[rows]
        assert (search.algorithm.pop.get("X") == survivors).all()
        assert len(survivors) == 12
        assert rows.max() >= 12


def test_a_search_with_nothing_to_ask_for_goes_on_from_a_record():
    still = nsga2(AlgorithmSettings(population=4, crossover_probability=0.0))
    still.mating.mutation.prob.value = 0.0  # children are their parents
    search = searched(still, 1)
    for number in (1, 2):
        assert search.ask().shape == (0, 3)
        others = np.full((4, 3), 0.1 * number)
        assert len(search.tell(others, *measured(others, 2))) == 4


def test_designs_measured_again_are_ranked_anew():
    search = searched(ours(20), 5)
    variables = search.algorithm.pop.get("X")
    values, excess = measured(variables, 2)
    # The best become the worst; the first two are ruled out.
    turned = np.concatenate([-values, values[:10] + 9])
    excess = np.concatenate([-np.ones_like(excess), -np.ones((10, 2))])
    excess[:2] = 1.0
    variables = np.concatenate([variables, variables[:10] / 2])
    rows = search.replace(variables, turned, excess)
    found = search.algorithm.pop
    assert (found.get("X") == variables[rows]).all()
    assert (found.get("F") == turned[rows]).all()
    assert len(rows) == 20
    assert not {0, 1} & set(rows.tolist())
    beaten = (turned[rows][:, None] < turned[rows][None]).all(axis=2).any(axis=0)
    assert (beaten == (found.get("rank").astype(int) > 0)).all()
    assert len(search.ask()) == 20


def test_nothing_is_printed(monkeypatch, capfd):
    """Results are on stdout; pymoo says there where it was installed without its compiled parts."""
    monkeypatch.setattr("pymoo.functions.is_compiled", lambda: False)
    monkeypatch.setattr(FunctionLoader, "_FunctionLoader__instance", None)
    searched(ours(12), 2)
    assert FunctionLoader.get_instance().is_compiled is False
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("algorithm", "objectives"),
    [
        (NSGA3(np.stack([np.linspace(0, 1, 12), np.linspace(1, 0, 12)], axis=1), pop_size=12), 2),
        (SMSEMOA(pop_size=12), 2),
        (SPEA2(pop_size=12), 2),
        (DE(pop_size=12), 1),
        (CMAES(x0=np.array([0.8, 0.8, 0.5]), sigma=0.1), 1),
    ],
    ids=["NSGA-III", "SMS-EMOA", "SPEA2", "DE", "CMA-ES"],
)
def test_the_driver_serves_any_algorithm(algorithm, objectives):
    constraints = 0 if isinstance(algorithm, CMAES) else 2
    search = Search(algorithm, space(objectives, constraints), 3)
    worth = []
    for _ in range(8):
        variables = search.ask()
        values, excess = measured(variables, objectives)
        before = search.algorithm.pop.get("X").reshape(-1, 3)
        rows = search.tell(variables, values, excess[:, :constraints])
        survivors = np.concatenate([before, variables])[rows]
        assert (survivors == search.algorithm.pop.get("X")).all()
        violation, found = search.algorithm.pop.get("CV", "F")
        worth.append(10 * violation.mean() + found[:, 0].mean())
    assert worth[-1] < worth[0]
