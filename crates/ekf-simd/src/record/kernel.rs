//! One trait for ACI and CWPA with their sensors, driven over a uniform record.

use ekf_core::error::DomainError;
use ekf_core::structured::acceleration::AccelerationModel;
use ekf_core::structured::aci::AciBlock;
use ekf_core::structured::cwpa::CwpaBlock;
use ekf_core::structured::measurement::OutputModel;
use ekf_core::structured::number::Number;
use ekf_core::structured::row::Row;

use crate::record::block::Block;
use crate::record::likelihood::{LogLikelihood, Logarithm};
use crate::record::runner::{Record, Runner};
use crate::record::settings::Settings;

/// A filter with its sensor, over a uniform record.
pub trait Kernel<V: Row<Number: Logarithm>, const M: usize>: Copy {
    /// Mean and covariance.
    type Block: Block<V, M>;

    /// Updates by the readings of sample 0.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse.
    fn start(
        &self,
        runner: &mut Runner<Self::Block, V::Number>,
        settings: &Settings<V, M>,
        record: &impl Record<V::Number>,
    ) -> Result<(), DomainError>;

    /// From one sample to a later one.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse.
    fn process(
        &self,
        runner: &mut Runner<Self::Block, V::Number>,
        settings: &Settings<V, M>,
        record: &impl Record<V::Number>,
        range: (usize, usize),
    ) -> Result<(), DomainError>;
}

/// The runner of a prior; `counted` asks for the log-likelihood.
#[inline(always)]
pub fn runner<K: Kernel<V, M>, V: Row<Number: Logarithm>, const M: usize>(
    witness: V::Number,
    counted: bool,
    x: impl Fn(usize) -> V::Number,
    P: impl Fn(usize, usize) -> V::Number,
) -> Runner<K::Block, V::Number> {
    Runner {
        block: K::Block::new(x, P),
        score: LogLikelihood::new(witness, counted),
        lowest: witness.like(f64::INFINITY),
    }
}

/// ACI with a sensor.
#[derive(Debug, Clone, Copy)]
pub struct AciWith<E> {
    /// How acceleration follows from the output.
    pub effect: E,
}

/// CWPA with a sensor.
#[derive(Debug, Clone, Copy)]
pub struct CwpaWith<O> {
    /// Acceleration computed from the output.
    pub sensor: O,
}

impl<V: Row<Number: Logarithm>, const M: usize, E: AccelerationModel<V, M, Input = V::Number>> Kernel<V, M>
    for AciWith<E>
{
    type Block = AciBlock<V, M>;

    #[inline(always)]
    fn start(
        &self,
        runner: &mut Runner<Self::Block, V::Number>,
        settings: &Settings<V, M>,
        record: &impl Record<V::Number>,
    ) -> Result<(), DomainError> {
        runner.read_position(settings, record.position(0));
        Ok(())
    }

    #[inline(always)]
    fn process(
        &self,
        runner: &mut Runner<Self::Block, V::Number>,
        settings: &Settings<V, M>,
        record: &impl Record<V::Number>,
        range: (usize, usize),
    ) -> Result<(), DomainError> {
        runner.process(&self.effect, settings, record, range)
    }
}

impl<V: Row<Number: Logarithm>, const M: usize, O: OutputModel<V> + Copy> Kernel<V, M> for CwpaWith<O> {
    type Block = CwpaBlock<V, M>;

    #[inline(always)]
    fn start(
        &self,
        runner: &mut Runner<Self::Block, V::Number>,
        settings: &Settings<V, M>,
        record: &impl Record<V::Number>,
    ) -> Result<(), DomainError> {
        runner.read_output(&self.sensor, settings.order, settings.R_output, record.reading(0))?;
        runner.read_position(settings, record.position(0));
        Ok(())
    }

    #[inline(always)]
    fn process(
        &self,
        runner: &mut Runner<Self::Block, V::Number>,
        settings: &Settings<V, M>,
        record: &impl Record<V::Number>,
        range: (usize, usize),
    ) -> Result<(), DomainError> {
        runner.process(&self.sensor, settings, record, range)
    }
}
