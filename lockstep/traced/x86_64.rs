//! Everything specific to x86-64: registers, the numbers of syscalls, the filter, the vDSO, `rdtsc`.

#[path = "x86_64/calls.rs"]
mod calls;
#[path = "x86_64/vdso.rs"]
mod vdso;

use std::io;

use crate::traced::memory::Memory;
use crate::traced::sys::{self, Tid};

pub(crate) use calls::{Syscall, call, filter};
pub(crate) use vdso::{Vdso, write_clocks};

#[derive(Clone, Copy)]
pub(crate) struct Registers(libc::user_regs_struct);

impl Registers {
    pub(crate) fn of(tid: Tid) -> io::Result<Self> {
        sys::registers(tid).map(Self)
    }

    pub(crate) fn set(&self, tid: Tid) -> io::Result<()> {
        sys::set_registers(tid, &self.0)
    }

    pub(crate) fn number(&self) -> i64 {
        self.0.orig_rax.cast_signed()
    }

    pub(crate) fn arguments(&self) -> [u64; 6] {
        let r = &self.0;
        [r.rdi, r.rsi, r.rdx, r.r10, r.r8, r.r9]
    }

    pub(crate) fn set_argument(&mut self, index: usize, value: u64) {
        let r = &mut self.0;
        let all = [
            &mut r.rdi, &mut r.rsi, &mut r.rdx, &mut r.r10, &mut r.r8, &mut r.r9,
        ];
        if let Some(argument) = all.into_iter().nth(index) {
            *argument = value;
        }
    }

    /// Skips the syscall, which returns `result`.
    pub(crate) fn answer(mut self, tid: Tid, result: i64) -> io::Result<()> {
        self.0.orig_rax = u64::MAX;
        self.0.rax = result.cast_unsigned();
        self.set(tid)
    }

    /// Result of the syscall, at its exit stop.
    pub(crate) fn result(&self) -> i64 {
        self.0.rax.cast_signed()
    }

    /// Changes what the syscall returns, at its exit stop.
    pub(crate) fn set_result(&mut self, result: i64) {
        self.0.rax = result.cast_unsigned();
    }

    /// At a syscall-exit stop: restarts the syscall, with the registers from its entry.
    pub(crate) fn make_again(&mut self) {
        self.0.rax = self.0.orig_rax;
        self.0.orig_rax = u64::MAX;
        // The instruction `syscall` has two bytes.
        self.0.rip -= 2;
    }

    /// Makes a syscall at such an instruction, wherever the program is.
    pub(crate) fn call(&self, gate: u64, number: i64, arguments: [u64; 6]) -> Self {
        let mut changed = *self;
        changed.0.rip = gate;
        changed.0.rax = number.cast_unsigned();
        changed.0.orig_rax = u64::MAX;
        for (index, argument) in arguments.into_iter().enumerate() {
            changed.set_argument(index, argument);
        }
        changed
    }

    /// Address of the program's current `syscall` instruction.
    pub(crate) fn gate(&self) -> u64 {
        self.0.rip.wrapping_sub(2)
    }

    pub(crate) fn stack(&self) -> u64 {
        self.0.rsp
    }

    pub(crate) fn place(&self) -> u64 {
        self.0.rip
    }

    pub(crate) fn is_native(&self) -> bool {
        // The code segment of 64-bit programs; that of 32-bit ones is 0x23.
        self.0.cs == 0x33
    }

    /// Returns the length of the instruction at hand if it reads the time stamp counter.
    pub(crate) fn time_stamp_length(&self, memory: Memory) -> Option<u64> {
        let mut code = [0; 3];
        match memory.read(self.0.rip, &mut code) {
            Ok(()) if code[..2] == [0x0F, 0x31] => Some(2),
            Ok(()) if code == [0x0F, 0x01, 0xF9] => Some(3),
            _ => None,
        }
    }

    /// Emulates such an instruction, which reads `ticks`.
    pub(crate) fn read_time_stamp(&mut self, length: u64, ticks: u64) {
        self.0.rax = ticks & 0xFFFF_FFFF;
        self.0.rdx = ticks >> 32;
        if length == 3 {
            self.0.rcx = 0;
        }
        self.0.rip += length;
    }
}

/// Writes these random bytes into a program that has just been loaded (`AT_RANDOM`); returns its vDSO, if its
/// functions can be replaced.
pub(crate) fn prepare_image(
    memory: Memory,
    stack: u64,
    random: Option<[u8; 16]>,
) -> io::Result<Option<Vdso>> {
    const AT_RANDOM: u64 = 25;
    const AT_SYSINFO_EHDR: u64 = 33;
    /// Arguments and environment have at most a quarter of the stack; this is beyond any limit.
    const MOST: u64 = 1 << 24;
    // The count of arguments, the arguments, a null, the environment, a null, the vector.
    let mut at = stack;
    let mut next = || {
        at += 8;
        if at - stack > MOST {
            return Err(io::Error::other("its stack is not as it should be"));
        }
        Ok((at, memory.read_u64(at)?))
    };
    for _ in 0..2 {
        while next()?.1 != 0 {}
    }
    let mut vdso = None;
    loop {
        let ((at, kind), (_, value)) = (next()?, next()?);
        match kind {
            0 => return Ok(vdso),
            AT_SYSINFO_EHDR => vdso = Vdso::find(memory, at, value)?,
            AT_RANDOM => {
                if let Some(random) = random {
                    memory.write(value, &random)?;
                }
            }
            _ => {}
        }
    }
}

/// What a new thread shares with the one that has made it.
#[derive(Clone, Copy, Default)]
pub(crate) struct Shared {
    pub(crate) process: bool,
    pub(crate) memory: bool,
    pub(crate) files: bool,
}

/// Returns what a syscall that has made another thread has it share.
pub(crate) fn shared(registers: &Registers) -> Shared {
    let flags = registers.arguments()[0];
    let has = |flag: i32| flags & u64::from(flag.cast_unsigned()) != 0;
    match registers.number() {
        libc::SYS_clone => Shared {
            process: has(libc::CLONE_THREAD),
            memory: has(libc::CLONE_VM),
            files: has(libc::CLONE_FILES),
        },
        number => Shared {
            memory: number == libc::SYS_vfork,
            ..Shared::default()
        },
    }
}
