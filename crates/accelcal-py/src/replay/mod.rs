//! Python's view of the replay: the two-state filter, its columns, several records at once.

pub mod columns;
pub mod dead_reckoning;
pub mod parallel;
pub mod track;
