"""Samplings and limits as objects: the same as single keywords."""

from dataclasses import fields

import pytest

import pmopt
from pmopt import Limits, Sampling
from pmopt.analysis.settings import SAMPLING, WorkspaceSettings

DESIGN = pmopt.mechanism("2pauu-ppap").design()


def test_a_sampling_has_the_settings_of_sampling():
    own = {k for k, f in WorkspaceSettings.model_fields.items() if SAMPLING in f.metadata}
    assert {f.name for f in fields(Sampling)} == own


@pytest.mark.parametrize(("sampling", "keywords"), [
    (Sampling(2048), {"samples": 2048}),
    (Sampling(2048, sampler="sobol", replicates=8),
     {"samples": 2048, "sampler": "sobol", "replicates": 8}),
    (Sampling.to_error(0.1), {"target_error": 0.1}),
    (Sampling.on_grid(8), {"grid": 8}),
], ids=str)  # fmt: skip
def test_it_says_what_keywords_say(sampling, keywords):
    limits = Limits(theta1=(-0.5, 1.5), theta2_deg=(-30, 80))
    one = DESIGN.workspace(sampling=sampling, limits=limits, shape_grid=0)
    two = DESIGN.workspace(**keywords, limits=dict(limits), shape_grid=0)
    assert one.to_dict() == two.to_dict()


def test_singularities_are_sampled_too():
    one = DESIGN.singularities(sampling=Sampling(2048), grid=14)
    assert one.to_dict() == DESIGN.singularities(samples=2048, grid=14).to_dict()


@pytest.mark.parametrize(("call", "line"), [
    (lambda: DESIGN.workspace(sampling=Sampling(64), samples=64),
     "^workspace: sampling and samples exclude each other: give one of them$"),
    (lambda: DESIGN.workspace(sampling=Sampling.to_error(0.1), grid=8),
     "sampling and grid exclude"),
    (lambda: DESIGN.workspace(sampling=Sampling(64, grid=8)), "samples and grid exclude"),
    (lambda: DESIGN.workspace(sampling=64), "sampling=64 is not allowed: a pmopt.Sampling"),
    (lambda: DESIGN.workspace(sampling=Sampling(3)), "workspace: samples=3 is not allowed"),
    (lambda: DESIGN.workspace(limits=Limits(theta3=(0, 1))), "theta3"),
    (lambda: DESIGN.singularities(sampling=Sampling.on_grid(9)), "grid of a sampling is not read"),
    (lambda: DESIGN.singularities(sampling=Sampling.to_error(0.1)),
     "target_error=0.1 is not read by singularities"),
    (lambda: DESIGN.certify(sampling=Sampling(64)), "certify: unknown name 'sampling'"),
])  # fmt: skip
def test_what_is_wrong_is_one_line(call, line):
    with pytest.raises(pmopt.InputError, match=line) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_they_print_as_they_are_written():
    assert repr(Sampling.to_error(1e-3)) == "Sampling.to_error(0.001)"
    assert repr(Sampling(64, sampler="sobol")) == "Sampling(samples=64, sampler='sobol')"
    assert repr(Limits(theta1=(-0.5, 1.5))) == "Limits(theta1=(-0.5, 1.5))"
