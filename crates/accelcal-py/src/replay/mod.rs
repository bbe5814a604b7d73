//! Python's view of the replay: the two-state filter, its columns, several records at once.

pub mod columns;
pub mod parallel;
pub mod track;
