//! The drift of all parameters of a structured kernel: `theta' = -rate theta + noise`, one [`GaussMarkov`] each.

use crate::dense::system::GaussMarkov;
use crate::structured::number::Number;
use crate::structured::row::Row;

/// The processes of all parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaussMarkovSet<V: Row, const M: usize> {
    processes: [GaussMarkov; M],
    rate: V,
    q: V,
}

impl<V: Row, const M: usize> GaussMarkovSet<V, M> {
    /// One [`GaussMarkov`] per parameter; of `witness` only the type is used.
    #[must_use]
    #[inline(always)]
    pub fn new(witness: V::Number, processes: [GaussMarkov; M]) -> Self {
        let row = |of: fn(&GaussMarkov) -> f64| V::from_fn(witness, |i| witness.like(of(&processes[i])));
        Self { processes, rate: row(|gauss_markov| gauss_markov.rate), q: row(|gauss_markov| gauss_markov.q) }
    }

    /// Whether every parameter is an unknown constant.
    #[must_use]
    pub fn is_constant(&self) -> bool {
        self.processes.iter().all(|gauss_markov| *gauss_markov == GaussMarkov::CONSTANT)
    }

    /// Densities of the noise.
    #[inline(always)]
    pub(crate) fn q(&self) -> V {
        self.q
    }

    /// What is left of each parameter after `s` seconds.
    #[inline(always)]
    pub(crate) fn decay(&self, witness: V::Number, s: f64) -> V {
        V::from_fn(witness, |i| witness.like(self.processes[i].decay(s)))
    }

    /// The rate at which a covariance with the parameters fades.
    #[inline(always)]
    pub(crate) fn decay_rate(&self, row: V) -> V {
        (self.rate * row).scaled(row.at(0).like(-1.0))
    }

    /// Time derivatives of the parameters and their covariance.
    #[inline(always)]
    pub(crate) fn rate(&self, theta: &V, P_theta: &[V; M]) -> (V, [V; M]) {
        let witness = theta.at(0);
        let mut rates = *P_theta;
        for (i, row) in rates.iter_mut().enumerate() {
            let gathered = V::from_fn(witness, |j| if i == j { self.q.at(i) } else { witness.like(0.0) });
            *row = gathered - (self.rate + V::every(self.rate.at(i))) * *row;
        }
        (self.decay_rate(*theta), rates)
    }

    /// The parameters and their covariance `s` seconds on.
    pub(crate) fn propagated(&self, theta: &V, P_theta: &[V; M], s: f64) -> (V, [V; M]) {
        let witness = theta.at(0);
        let decay = self.decay(witness, s);
        let mut propagated = *P_theta;
        for (i, row) in propagated.iter_mut().enumerate() {
            let gathered = witness.like(self.processes[i].variance(s));
            let diagonal = V::from_fn(witness, |j| if i == j { gathered } else { witness.like(0.0) });
            *row = *row * decay.scaled(decay.at(i)) + diagonal;
        }
        (*theta * decay, propagated)
    }
}
