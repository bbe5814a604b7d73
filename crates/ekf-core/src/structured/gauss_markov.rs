//! All parameters of a structured kernel on the move: `theta' = -rate theta + noise`, one [`Wander`] each.

use crate::dense::system::Wander;
use crate::structured::number::Number;
use crate::structured::row::Row;

/// How all parameters move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wandering<V: Row, const M: usize> {
    each: [Wander; M],
    rate: V,
    q: V,
}

impl<V: Row, const M: usize> Wandering<V, M> {
    /// One [`Wander`] per parameter; `kind` lends its kind.
    #[must_use]
    #[inline(always)]
    pub fn new(kind: V::Number, each: [Wander; M]) -> Self {
        let row = |of: fn(&Wander) -> f64| V::from_fn(kind, |i| kind.like(of(&each[i])));
        Self { each, rate: row(|wander| wander.rate), q: row(|wander| wander.q) }
    }

    /// Whether every parameter is an unknown constant.
    #[must_use]
    pub fn still(&self) -> bool {
        self.each.iter().all(|wander| *wander == Wander::CONSTANT)
    }

    /// Densities of the noise.
    #[inline(always)]
    pub(crate) fn q(&self) -> V {
        self.q
    }

    /// What is left of each parameter after `s` seconds.
    #[inline(always)]
    pub(crate) fn decay(&self, kind: V::Number, s: f64) -> V {
        V::from_fn(kind, |i| kind.like(self.each[i].decay(s)))
    }

    /// The rate at which a covariance with the parameters fades.
    #[inline(always)]
    pub(crate) fn fading(&self, row: V) -> V {
        (self.rate * row).scaled(row.at(0).like(-1.0))
    }

    /// Time derivatives of the parameters and their covariance.
    #[inline(always)]
    pub(crate) fn rate(&self, theta: &V, spread: &[V; M]) -> (V, [V; M]) {
        let kind = theta.at(0);
        let mut rates = *spread;
        for (i, row) in rates.iter_mut().enumerate() {
            let gathered = V::from_fn(kind, |j| if i == j { self.q.at(i) } else { kind.like(0.0) });
            *row = gathered - (self.rate + V::every(self.rate.at(i))) * *row;
        }
        (self.fading(*theta), rates)
    }

    /// The parameters and their covariance `s` seconds on.
    pub(crate) fn later(&self, theta: &V, spread: &[V; M], s: f64) -> (V, [V; M]) {
        let kind = theta.at(0);
        let decay = self.decay(kind, s);
        let mut later = *spread;
        for (i, row) in later.iter_mut().enumerate() {
            let gathered = kind.like(self.each[i].variance(s));
            let diagonal = V::from_fn(kind, |j| if i == j { gathered } else { kind.like(0.0) });
            *row = row.scaled(decay.at(i)) * decay + diagonal;
        }
        (*theta * decay, later)
    }
}
