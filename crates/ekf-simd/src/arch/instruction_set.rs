//! The instruction sets a run can be compiled for, and which of them this processor has.

/// The instructions that a batch runs on, and how many runs share a register.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum InstructionSet {
    /// One run at a time on plain numbers, nothing fused: any processor, equal bits on all.
    Portable,
    /// One run at a time, AVX2 and FMA, four parameters to a register; with the 32 registers of AVX-512VL where it is there.
    Fused,
    /// Four runs side by side, AVX2 and FMA.
    Four,
    /// Eight runs side by side, AVX-512.
    Eight,
}

impl InstructionSet {
    /// Whether this processor has the instructions.
    #[must_use]
    pub fn is_available(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Fused | Self::Four => pulp::x86::V3::try_new().is_some(),
            #[cfg(target_arch = "x86_64")]
            Self::Eight => pulp::x86::V4::try_new().is_some(),
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// The widest set that this processor has.
    #[must_use]
    pub fn best() -> Self {
        Self::Eight.or_narrower()
    }

    /// This set where the processor has it, else the widest below it, whose answer has the same bits if it is fused too.
    #[must_use]
    pub fn or_narrower(self) -> Self {
        let sets: &[Self] = match self {
            Self::Portable => &[],
            Self::Fused => &[Self::Fused],
            Self::Four => &[Self::Four],
            Self::Eight => &[Self::Eight, Self::Four],
        };
        sets.iter().copied().find(|path| path.is_available()).unwrap_or(Self::Portable)
    }

    /// Runs side by side.
    #[must_use]
    pub fn lanes(self) -> usize {
        match self {
            Self::Portable | Self::Fused => 1,
            Self::Four => 4,
            Self::Eight => 8,
        }
    }
}
