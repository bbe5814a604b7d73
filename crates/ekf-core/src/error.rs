//! Errors of a set-up, a step and a run, with the numbers that explain them.

use core::error::Error;
use core::fmt;

use crate::signal::channel::Channel;

/// A sensor model has no value at the argument.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum DomainError {
    /// The slope at zero, `1 + k` (forward) or `1 - k` (inverse), is not positive.
    Slope {
        /// The slope found, 1.
        slope: f64,
    },
    /// The cubic turns over before it reaches the value that is to be inverted.
    Outside {
        /// The value to be inverted, m/s^2, bias taken off.
        value: f64,
        /// Lower end of the invertible range, m/s^2.
        low: f64,
        /// Upper end of the invertible range, m/s^2.
        high: f64,
    },
}

impl fmt::Display for DomainError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Slope { slope } => {
                write!(f, "the sensor's slope at zero is {slope}, not positive")
            }
            Self::Outside { value, low, high } => write!(
                f,
                "the sensor model cannot be inverted at {value} m/s^2: it is monotone from {low} to {high} only"
            ),
        }
    }
}

impl Error for DomainError {}

/// One prediction or one update failed; the belief before it is untouched.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum StepError {
    /// `S = H P H' + R` is not positive and finite.
    InnovationVariance {
        /// The `S` found, in the unit of the reading squared.
        s: f64,
    },
    /// The innovation `e` or `e^2 / S` is not finite: the reading or the state is not, or is far too large.
    Innovation {
        /// The `e` found, in the unit of the reading.
        e: f64,
    },
    /// The mean of a state is not finite.
    Mean {
        /// Index of the state.
        state: usize,
    },
    /// `P` has a negative or non-finite variance.
    Variance {
        /// Index of the state.
        state: usize,
        /// Its variance.
        variance: f64,
    },
    /// `P` correlates two states by more than one.
    Correlation {
        /// Their indices.
        states: (usize, usize),
        /// The square of the correlation coefficient found, 1.
        squared: f64,
    },
    /// The sensor model has no value at the estimate.
    Domain(DomainError),
    /// An event is older than the one before it, or two outputs share an instant.
    TimeOrder {
        /// Time of the event, s.
        t: f64,
        /// Time of the event before it, s.
        previous: f64,
    },
    /// Too many readings wait for the output sample that would let them be processed.
    Backlog {
        /// How many may wait.
        capacity: usize,
    },
}

impl StepError {
    /// The variant's name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::InnovationVariance { .. } => "InnovationVariance",
            Self::Innovation { .. } => "Innovation",
            Self::Mean { .. } => "Mean",
            Self::Variance { .. } => "Variance",
            Self::Correlation { .. } => "Correlation",
            Self::Domain(_) => "Domain",
            Self::TimeOrder { .. } => "TimeOrder",
            Self::Backlog { .. } => "Backlog",
        }
    }
}

impl fmt::Display for StepError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::InnovationVariance { s } => {
                write!(f, "the innovation variance is {s}, not positive and finite")
            }
            Self::Innovation { e } => write!(f, "the innovation {e}, or its square over its variance, is not finite"),
            Self::Mean { state } => write!(f, "the estimate of state {state} is not finite"),
            Self::Variance { state, variance } => {
                write!(f, "positive definiteness is lost: state {state} has variance {variance:.3e}")
            }
            Self::Correlation { states, squared } => write!(
                f,
                "positive definiteness is lost: states {} and {} have squared correlation {squared}",
                states.0, states.1
            ),
            Self::Domain(error) => error.fmt(f),
            Self::TimeOrder { t, previous } => {
                write!(f, "time {t} s does not follow {previous} s")
            }
            Self::Backlog { capacity } => write!(f, "more than {capacity} events wait for the next output sample"),
        }
    }
}

impl Error for StepError {}

impl From<DomainError> for StepError {
    fn from(error: DomainError) -> Self {
        Self::Domain(error)
    }
}

/// A filter or a record cannot be used as it is.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum SetupError {
    /// The number of states does not fit the system.
    Size {
        /// States that were given.
        given: usize,
    },
    /// A setting lies outside its range.
    Setting {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A state is to be considered and not estimated where the covariance has no such update.
    Consider {
        /// Index of the first such state.
        state: usize,
    },
    /// The filter has a choice that its structured kernel lacks: the factored carrier, a low-pass in CWPA.
    NoKernel,
    /// The initial covariance is not symmetric and non-negative definite.
    Prior {
        /// State at which the factorisation failed.
        state: usize,
        /// The pivot found there.
        pivot: f64,
    },
    /// The initial mean and covariance are none that a filter could have.
    Belief(StepError),
    /// A channel has fewer samples than the filter needs.
    TooFew {
        /// The channel.
        channel: Channel,
        /// Samples it has.
        count: usize,
        /// Samples it needs.
        needed: usize,
    },
    /// The stamps and the samples of a channel differ in number.
    Lengths {
        /// The channel.
        channel: Channel,
        /// Number of stamps.
        times: usize,
        /// Number of samples.
        values: usize,
    },
    /// A stamp or a sample is not finite.
    NotFinite {
        /// The channel.
        channel: Channel,
        /// Index of the sample.
        index: usize,
    },
    /// The stamps of a channel do not rise strictly.
    NotRising {
        /// The channel.
        channel: Channel,
        /// Index of the later sample.
        index: usize,
        /// Its stamp, s.
        t: f64,
    },
}

impl SetupError {
    /// The variant's name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Size { .. } => "Size",
            Self::Setting { .. } => "Setting",
            Self::Consider { .. } => "Consider",
            Self::NoKernel => "NoKernel",
            Self::Prior { .. } => "Prior",
            Self::Belief(_) => "Belief",
            Self::TooFew { .. } => "TooFew",
            Self::Lengths { .. } => "Lengths",
            Self::NotFinite { .. } => "NotFinite",
            Self::NotRising { .. } => "NotRising",
        }
    }
}

impl fmt::Display for SetupError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Size { given } => write!(f, "{given} states do not fit the system"),
            Self::Setting { name, value } => write!(f, "{name} = {value} is out of range"),
            Self::Consider { state } => write!(
                f,
                "state {state} is to be considered and not estimated, which only the dense filter in Joseph's form can do"
            ),
            Self::NoKernel => f.write_str("no structured kernel has the factored carrier or a low-pass in CWPA"),
            Self::Prior { state, pivot } => {
                write!(f, "the initial covariance is not positive definite: pivot {pivot} at state {state}")
            }
            Self::Belief(error) => write!(f, "the initial belief: {error}"),
            Self::TooFew { channel, count, needed } => {
                write!(f, "{channel}: {count} samples, at least {needed} are needed")
            }
            Self::Lengths { channel, times, values } => write!(f, "{channel}: {times} stamps but {values} samples"),
            Self::NotFinite { channel, index } => {
                write!(f, "{channel}: sample {index} or its stamp is not finite")
            }
            Self::NotRising { channel, index, t } => {
                write!(f, "{channel}: stamp {index} at {t} s does not rise above the one before")
            }
        }
    }
}

impl Error for SetupError {}

/// A run over a record failed.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum RunError {
    /// Before the first step.
    Setup(SetupError),
    /// At one event.
    Step {
        /// How many events were processed before it.
        event: usize,
        /// Its time, s.
        t: f64,
        /// What happened.
        error: StepError,
    },
}

impl RunError {
    /// The name of the variant inside.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Setup(error) => error.name(),
            Self::Step { error, .. } => error.name(),
        }
    }
}

impl fmt::Display for RunError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Setup(error) => error.fmt(f),
            Self::Step { event, t, error } => write!(f, "event {event} at t = {t} s: {error}"),
        }
    }
}

impl Error for RunError {}

impl From<SetupError> for RunError {
    fn from(error: SetupError) -> Self {
        Self::Setup(error)
    }
}

#[cfg(feature = "std")]
mod io {
    use super::{DomainError, RunError, SetupError, StepError};

    /// The errors as `std::io::Error` of kind `InvalidData`, for functions that also read files.
    macro_rules! invalid_data {
        ($($error:ty),*) => {
            $(impl From<$error> for std::io::Error {
                fn from(error: $error) -> Self {
                    Self::new(std::io::ErrorKind::InvalidData, error)
                }
            })*
        };
    }

    invalid_data!(DomainError, StepError, SetupError, RunError);
}
