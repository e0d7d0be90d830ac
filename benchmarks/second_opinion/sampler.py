# SPDX-License-Identifier: Apache-2.0
"""numpyro's sampler over the sets: Gibbs steps on what stands in each place, and NUTS on the rate of inclusion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.second_opinion.hypotheses import SIZES_M, TOGETHER
from benchmarks.second_opinion.table import Sampled, drawn_forms

if TYPE_CHECKING:
    from benchmarks.second_opinion.table import Table

WARM_UP, SAMPLES, CHAINS = 500, 4000, 2


def sample(table: Table, seed: int = 0) -> Sampled:
    """Two chains from different draws of the prior."""
    import jax
    import numpyro
    from numpyro.diagnostics import split_gelman_rubin
    from numpyro.infer import MCMC, NUTS, DiscreteHMCGibbs

    numpyro.enable_x64()
    kernel = DiscreteHMCGibbs(NUTS(model))
    mcmc = MCMC(kernel, num_warmup=WARM_UP, num_samples=SAMPLES, num_chains=CHAINS, chain_method="sequential", progress_bar=False)
    mcmc.run(jax.random.PRNGKey(seed), jax.numpy.asarray(table.dense()), table.names)
    found = {name: np.asarray(values) for name, values in mcmc.get_samples(group_by_chain=True).items()}
    there = drawn_forms(found["place"], len(table.forms))
    varied = [there[..., i] for i in range(there.shape[-1]) if np.ptp(there[..., i]) > 0]
    return Sampled(there.mean(axis=1), max(float(split_gelman_rubin(v)) for v in [*varied, found["rate"]]))


def model(values: Any, names: int) -> None:
    """Spike and slab: a rate of inclusion, what stands in each place (0 for nothing), and the maps' size; `values` as of `Table.dense`."""
    import jax.numpy as jnp
    import numpyro
    from numpyro import distributions as dist

    rate = numpyro.sample("rate", dist.Beta(1.0, float(names)))
    size = numpyro.sample("size", dist.Categorical(jnp.ones(len(SIZES_M)) / len(SIZES_M)))
    choices = values.shape[1]
    with numpyro.plate("places", TOGETHER):
        place = numpyro.sample("place", dist.Categorical(jnp.ones(choices) / choices))
    count = (place > 0).sum()
    numpyro.factor("evidence", values[(size, *place)] + count * jnp.log(rate) + (names - count) * jnp.log1p(-rate))
