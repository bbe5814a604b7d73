//! No step allocates: counted by the allocator of this test.
#![allow(non_snake_case)] // as in the crates

use std::alloc::{GlobalAlloc, Layout, System as Heap};
use std::cell::Cell;
use std::hint::black_box;

use ekf_core::structured::acceleration::{AccelerationModel, InverseCubic};
use ekf_core::structured::aci::StepIntegrals;
use ekf_core::structured::aci_ud::AciFactored;
use ekf_core::structured::row::Plain;
use ekf_core::{
    Aci, Belief, Carrier, Channel, Consider, Correction, Cwpa, Engine, Event, Filter, Form, GaussMarkov, InBlocks,
    Integrator, Interpolation, Live, Order, Sensor,
};
use ekf_simd::Prior;
use ekf_simd::fixed_rate::filter::{FixedRate, Histories, aci, aci_with_effects, cwpa};
use ekf_simd::fixed_rate::step::{EffectColumns, SampleInput};
use nalgebra::{SMatrix, SVector};

/// The system's allocator, counting what the present thread asks for.
struct Counting;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call is handed to the system's allocator unchanged; a `Cell` made in a constant, without a destructor, is
// counted up without allocating or unwinding.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.set(COUNT.get() + 1);
        // SAFETY: the caller holds the contract of `alloc`, which is the one of this call.
        unsafe { Heap.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: `at` is from `Heap.alloc` above, with this layout.
        unsafe { Heap.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations(work: impl FnOnce()) -> usize {
    let before = COUNT.get();
    work();
    COUNT.get() - before
}

const DT: f64 = 1.0 / 1667.0;
const STEPS: usize = 300;

fn sensor(form: Form) -> Sensor {
    Sensor { form, gauss_markov: [GaussMarkov::CONSTANT; 4] }
}

fn filter<S>(system: S, integrator: Integrator, carrier: Carrier) -> Filter<S> {
    Filter {
        system,
        interpolation: Interpolation::Linear,
        integrator,
        order: Order::Second,
        carrier,
        consider: Consider::NONE,
        R_position: 1e-12,
        R_output: 1e-4,
        gate: f64::INFINITY,
    }
}

fn belief<const N: usize>() -> Belief<N> {
    let sigma = SVector::<f64, N>::from_fn(|i, _| [1e-5, 3e-3].get(i).copied().unwrap_or(1e-3));
    Belief { x: SVector::zeros(), P: SMatrix::from_diagonal(&sigma.component_mul(&sigma)) }
}

fn output(j: usize) -> f64 {
    8.0 * (0.02 * j as f64).sin()
}

/// The position under that output from rest: with any other, a cubic sensor leaves its domain.
fn position(j: usize) -> f64 {
    let (w, turned) = (0.02 / DT, 0.02 * j as f64);
    8.0 / (w * w) * (turned - turned.sin())
}

/// Both channels, position at every second sample.
fn streamed<E: Engine<N>, const N: usize>(engine: E) -> usize {
    let mut live = Live::new(engine, &belief::<N>()).unwrap();
    allocations(|| {
        for j in 0..STEPS {
            let t = j as f64 * DT;
            live.push(Event { t, channel: Channel::Output, value: output(j) }, |_| ()).unwrap();
            if j % 2 == 0 {
                live.push(Event { t, channel: Channel::Position, value: position(j) }, |_| ()).unwrap();
            }
        }
        black_box(live.track());
    })
}

fn fixed_rate_steps(filter: &mut dyn FixedRate, effects: usize) -> usize {
    let columns = [0.3; 14];
    let effects = &columns[..effects];
    let mut states = vec![0.0; 2 * filter.states()];
    allocations(|| {
        for j in 0..STEPS {
            let z = if j % 2 == 0 { position(j) } else { f64::NAN };
            let columns = EffectColumns { over: [effects; 3], position: effects, slopes: &[] };
            let sample = SampleInput { u: output(j), z, effects: Some(&columns), suspects: None };
            filter.step(&sample).unwrap();
        }
        let mut histories = Histories { states: Some(&mut states), ..Histories::default() };
        filter.over(&[output(STEPS), output(STEPS + 1)], &[position(STEPS), f64::NAN], &mut histories).unwrap();
        black_box((filter.x(0), filter.P(0, 0), filter.innovation(), filter.log_likelihood()));
    })
}

#[test]
fn what_allocates_is_counted() {
    assert_eq!(allocations(|| drop(black_box(vec![0.0; 3]))), 1);
}

#[test]
fn no_step_of_a_stream_allocates() {
    for integrator in [Integrator::Rk4, Integrator::Exact] {
        for form in [Form::Inverse, Form::Forward] {
            let driven = Aci { sensor: sensor(form), q: 1e-6, tau: 0.0 };
            let read = Cwpa { sensor: sensor(form), q: 25.0, low_pass: None };
            for carrier in [Carrier::Dense, Carrier::Factored] {
                assert_eq!(streamed::<_, 4>(filter(driven, integrator, carrier)), 0);
                assert_eq!(streamed::<_, 6>(filter(driven, integrator, carrier)), 0);
                assert_eq!(streamed::<_, 5>(filter(read, integrator, carrier)), 0);
                assert_eq!(streamed::<_, 7>(filter(read, integrator, carrier)), 0);
            }
            assert_eq!(streamed::<_, 4>(InBlocks(filter(driven, integrator, Carrier::Dense))), 0);
            assert_eq!(streamed::<_, 6>(InBlocks(filter(driven, integrator, Carrier::Dense))), 0);
            assert_eq!(streamed::<_, 5>(InBlocks(filter(read, integrator, Carrier::Dense))), 0);
            assert_eq!(streamed::<_, 7>(InBlocks(filter(read, integrator, Carrier::Dense))), 0);
        }
    }
}

#[test]
fn no_step_at_a_fixed_rate_allocates() {
    let numbers = |N: usize| {
        let sigma = |i: usize| -> f64 { [1e-5, 3e-3].get(i).copied().unwrap_or(1e-3) };
        let P = (0..N * N).map(|at| if at / N == at % N { sigma(at / N).powi(2) } else { 0.0 }).collect();
        (vec![0.0; N], P)
    };
    for integrator in [Integrator::Rk4, Integrator::Exact] {
        for (form, N) in [(Form::Inverse, 4), (Form::Inverse, 6), (Form::Forward, 4), (Form::Forward, 6)] {
            let (x, P): (Vec<f64>, Vec<f64>) = numbers(N);
            let system = Aci { sensor: sensor(form), q: 1e-6, tau: 0.0 };
            let chosen = filter(system, integrator, Carrier::Dense);
            let mut steps = aci(&chosen, Correction::None, DT, Prior { states: N, x: &x, P: &P }).unwrap();
            assert_eq!(fixed_rate_steps(&mut *steps, 0), 0);
            let (x, P): (Vec<f64>, Vec<f64>) = numbers(N + 1);
            let system = Cwpa { sensor: sensor(form), q: 25.0, low_pass: None };
            let chosen = filter(system, integrator, Carrier::Dense);
            let mut steps = cwpa(&chosen, DT, Prior { states: N + 1, x: &x, P: &P }).unwrap();
            assert_eq!(fixed_rate_steps(&mut *steps, 0), 0);
        }
        for effects in [0, 1, 6, 14] {
            let N = 4 + effects;
            let (x, P): (Vec<f64>, Vec<f64>) = numbers(N);
            let system = Aci { sensor: sensor(Form::Forward), q: 1e-6, tau: 1e-3 };
            let chosen = filter(system, integrator, Carrier::Dense);
            let prior = Prior { states: N, x: &x, P: &P };
            let mut steps = aci_with_effects(&chosen, Correction::None, DT, 9.8, &[], prior).unwrap();
            assert_eq!(fixed_rate_steps(&mut *steps, effects), 0);
        }
    }
}

#[test]
#[allow(clippy::cast_possible_truncation)] // single precision is what runs present
fn no_step_of_the_portable_factored_filter_allocates() {
    let mut factored = AciFactored::<f32, 6, 4>::new(|_| 0.0, |_, _| 0.0, |i| if i == 0 { 1e-10 } else { 1e-4 });
    let count = allocations(|| {
        for j in 0..STEPS {
            let table =
                AccelerationModel::<_, 4>::table(&InverseCubic, &factored.theta, &[Plain([0.0; 4]); 4], Order::First);
            let at = AccelerationModel::<_, 4>::at(&InverseCubic, &table, output(j) as f32).unwrap();
            factored.predict(DT as f32, &StepIntegrals::held(DT, 1e-6, &at));
            factored.correct(1e-12, &factored.innovate(0.0, 1e-12));
        }
        black_box(factored.P(0, 0));
    });
    assert_eq!(count, 0);
}
