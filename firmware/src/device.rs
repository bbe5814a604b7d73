//! The tracker on a Cortex-M in QEMU: start-up, the run with instructions and stack counted, the report, the end.
//!
//! Instructions are ticks of the system timer under `-icount`, under which every instruction takes equal time. The report
//! is lines of a name and sixteen hexadecimal digits.
#![no_std]
#![no_main]

use core::arch::{asm, global_asm};

use firmware::{Number, Sample, Tracker, run};

// Vectors, then the floating-point unit (coprocessors 10 and 11) before any Rust: its functions may begin with a `vpush`.
global_asm!(
    ".section .vectors, \"a\", %progbits",
    ".word stack_top, reset",
    ".rept 14",
    ".word fault",
    ".endr",
    ".section .text.reset, \"ax\", %progbits",
    ".thumb_func",
    ".global reset",
    "reset:",
    "ldr r0, =0xE000ED88",
    "ldr r1, [r0]",
    "orr r1, r1, #0xF00000",
    "str r1, [r0]",
    "dsb",
    "isb",
    "bl main",
    ".thumb_func",
    "fault:",
    "movs r0, #0x18",
    "ldr r1, =0x20023",
    "bkpt 0xAB",
    "b .",
);

/// As many steps as the host takes.
const STEPS: u32 = 20_000;
/// Words of stack that a step is watched on, and what untouched ones hold.
const WATCHED: usize = 256;
const UNTOUCHED: u32 = 0xA5A5_A5A5;

/// The largest counts of any step.
#[derive(Default)]
struct Cost {
    without_reading: u32,
    with_reading: u32,
    stack: u32,
}

// SAFETY: the start code looks for this name, and no other function has it.
#[unsafe(no_mangle)]
extern "C" fn main() -> ! {
    timer_start();
    let overhead = elapsed(|| ());
    let mut cost = Cost::default();
    let (digest, _) = run(STEPS, |tracker, sample| {
        let stack = stack_paint();
        let ticks = elapsed(|| step(tracker, &sample)) - overhead;
        let worst = if sample.position.is_some() { &mut cost.with_reading } else { &mut cost.without_reading };
        *worst = ticks.max(*worst);
        cost.stack = stack_used(stack).max(cost.stack);
    });
    report(c"digest ", digest);
    report(c"ticks_predict ", cost.without_reading.into());
    report(c"ticks_predict_update ", cost.with_reading.into());
    report(c"stack ", cost.stack.into());
    report(c"state ", size_of::<Tracker<Number>>() as u64);
    semihost(0x18, 0x20026);
    loop {}
}

/// What is counted: a call, as an interrupt would make it.
#[inline(never)]
fn step(tracker: &mut Tracker<Number>, sample: &Sample) {
    tracker.step(sample.output.into(), sample.position.map(Number::from));
}

const TIMER: *mut u32 = 0xE000_E010 as *mut u32;

fn timer_start() {
    // SAFETY: control, reload and value of the system timer, which nobody else uses.
    unsafe {
        TIMER.add(1).write_volatile(0x00FF_FFFF);
        TIMER.add(2).write_volatile(0);
        TIMER.write_volatile(5);
    }
}

/// Ticks that `f` takes, up to 2^24.
#[inline(always)]
fn elapsed(f: impl FnOnce()) -> u32 {
    // SAFETY: the value of the system timer, which counts down.
    let now = || unsafe { TIMER.add(2).read_volatile() };
    let before = now();
    f();
    before.wrapping_sub(now()) & 0x00FF_FFFF
}

/// Paints the stack below the caller, and returns where it begins.
#[inline(always)]
fn stack_paint() -> *mut u32 {
    let top: *mut u32;
    // SAFETY: below the stack pointer nothing is alive, no interrupt is on, the memory reaches further down than `WATCHED`,
    // and in an optimised image, the only one that is run, the loop calls nothing.
    unsafe {
        asm!("mov {}, sp", out(reg) top, options(nomem, nostack));
        for word in 1..=WATCHED {
            top.sub(word).write_volatile(UNTOUCHED);
        }
    }
    top
}

/// Bytes below `top` that have been written since.
#[inline(always)]
fn stack_used(top: *mut u32) -> u32 {
    // SAFETY: the words that `stack_paint` wrote.
    let untouched = (1..=WATCHED).rev().take_while(|word| unsafe { top.sub(*word).read_volatile() } == UNTOUCHED);
    4 * (WATCHED - untouched.count()) as u32
}

#[inline(never)]
fn report(name: &core::ffi::CStr, mut value: u64) {
    semihost(0x04, name.as_ptr() as usize);
    for _ in 0..16 {
        value = value.rotate_left(4);
        let digit = value as u8 & 15;
        let letter = if digit < 10 { b'0' + digit } else { b'a' - 10 + digit };
        semihost(0x03, &raw const letter as usize);
    }
    semihost(0x04, c"\n".as_ptr() as usize);
}

/// Asks the debugger, here QEMU: 3 writes a letter, 4 a string, 0x18 ends.
fn semihost(operation: u32, argument: usize) {
    // SAFETY: the operations above only read; every caller here gives the address of a letter or of a string with its end.
    unsafe { asm!("bkpt 0xAB", inout("r0") operation => _, in("r1") argument, options(nostack)) }
}
