//! Clocks inside of a program, so that reading them is no syscall.
//!
//! The vDSO is a small library that the kernel puts into each program and that reads the real
//! clock. Its functions are replaced by ones that read simulated time from a page of the program's
//! own memory, which the tracer writes before it lets the program go on when time has. Whatever
//! else it has is taken out: programs make a syscall then, as they do where a kernel lacks it.
#![expect(
    unsafe_code,
    reason = "the address of what the assembler has made has no safe name"
)]

use std::arch::global_asm;
use std::io;

use crate::traced::clock::{parts, parts_micros};
use crate::traced::memory::Memory;
use crate::traced::sys::{self, Tid};

// The functions find the page of the clocks through the word at the beginning. In the page:
//    0  how often may be queried before it costs a syscall
//    8  seconds and nanoseconds of the real-time clock
//   24  those of the monotonic clock
//   40  microseconds of the real-time clock
// Numbers of clocks: real time is 0, 5, 8 and 11; monotonic are 1, 4, 6, 7 and 9.
global_asm!(
    ".pushsection .rodata.sim_lockstep, \"a\", @progbits",
    ".globl sim_lockstep_vdso, sim_lockstep_clock_gettime, sim_lockstep_gettimeofday",
    ".globl sim_lockstep_time, sim_lockstep_vdso_end",
    ".hidden sim_lockstep_vdso, sim_lockstep_clock_gettime, sim_lockstep_gettimeofday",
    ".hidden sim_lockstep_time, sim_lockstep_vdso_end",
    ".balign 16",
    "sim_lockstep_vdso:",
    "    .quad 0",
    "sim_lockstep_clock_gettime:",
    "    cmp edi, 11",
    "    ja 3f",
    "    mov rdx, qword ptr [rip + sim_lockstep_vdso]",
    "    lea r8, [rdx + 8]",
    "    mov ecx, edi",
    "    mov eax, 1",
    "    shl eax, cl",
    "    test eax, 0x921",
    "    jnz 2f",
    "    lea r8, [rdx + 24]",
    "    test eax, 0x2d2",
    "    jz 3f",
    "2:  cmp dword ptr [rdx], 0",
    "    je 3f",
    "    dec dword ptr [rdx]",
    "    mov rax, qword ptr [r8]",
    "    mov qword ptr [rsi], rax",
    "    mov rax, qword ptr [r8 + 8]",
    "    mov qword ptr [rsi + 8], rax",
    "    xor eax, eax",
    "    ret",
    "3:  mov eax, {clock_gettime}",
    "    syscall",
    "    ret",
    "sim_lockstep_gettimeofday:",
    "    mov rdx, qword ptr [rip + sim_lockstep_vdso]",
    "    test rdi, rdi",
    "    jz 3f",
    "    test rsi, rsi",
    "    jnz 3f",
    "    cmp dword ptr [rdx], 0",
    "    je 3f",
    "    dec dword ptr [rdx]",
    "    mov rax, qword ptr [rdx + 8]",
    "    mov qword ptr [rdi], rax",
    "    mov rax, qword ptr [rdx + 40]",
    "    mov qword ptr [rdi + 8], rax",
    "    xor eax, eax",
    "    ret",
    "3:  mov eax, {gettimeofday}",
    "    syscall",
    "    ret",
    "sim_lockstep_time:",
    "    mov rdx, qword ptr [rip + sim_lockstep_vdso]",
    "    cmp dword ptr [rdx], 0",
    "    je 3f",
    "    dec dword ptr [rdx]",
    "    mov rax, qword ptr [rdx + 8]",
    "    test rdi, rdi",
    "    jz 2f",
    "    mov qword ptr [rdi], rax",
    "2:  ret",
    "3:  mov eax, {time}",
    "    syscall",
    "    ret",
    "sim_lockstep_vdso_end:",
    ".popsection",
    clock_gettime = const libc::SYS_clock_gettime,
    gettimeofday = const libc::SYS_gettimeofday,
    time = const libc::SYS_time,
);

unsafe extern "C" {
    static sim_lockstep_vdso: [u8; 0];
    static sim_lockstep_clock_gettime: [u8; 0];
    static sim_lockstep_gettimeofday: [u8; 0];
    static sim_lockstep_time: [u8; 0];
    static sim_lockstep_vdso_end: [u8; 0];
}

/// Distance of a place in the code from its beginning.
fn offset(place: *const [u8; 0]) -> usize {
    place.addr() - (&raw const sim_lockstep_vdso).addr()
}

/// The code, for a page of clocks at that address.
fn code(clocks: u64) -> Vec<u8> {
    let length = offset(&raw const sim_lockstep_vdso_end);
    // SAFETY: the assembler has put both labels around constant bytes of this program.
    let code =
        unsafe { std::slice::from_raw_parts((&raw const sim_lockstep_vdso).cast::<u8>(), length) };
    let mut code = code.to_vec();
    code[..8].copy_from_slice(&clocks.to_ne_bytes());
    // Whole words are written.
    code.resize(length.next_multiple_of(8), 0);
    code
}

/// Offset of what takes the place of a function of the vDSO.
fn replacement(name: &[u8]) -> Option<usize> {
    let name = name.strip_prefix(b"__vdso_").unwrap_or(name);
    Some(match name {
        b"clock_gettime" => offset(&raw const sim_lockstep_clock_gettime),
        b"gettimeofday" => offset(&raw const sim_lockstep_gettimeofday),
        b"time" => offset(&raw const sim_lockstep_time),
        _ => return None,
    })
}

/// Bytes of the vDSO, of which nothing is taken for granted.
struct Image(Vec<u8>);

/// A function of it: where its symbol is and how that begins, where its code is, and how long.
struct Function {
    entry: usize,
    symbol: [u8; 16],
    code: usize,
    length: usize,
    name: Vec<u8>,
}

impl Image {
    const HEADER: usize = 64;
    const SEGMENT: usize = 56;
    const SYMBOL: usize = 24;
    /// No kernel has one that is as long.
    const MOST: usize = 1 << 16;

    fn read(memory: Memory, base: u64) -> Option<Self> {
        let mut bytes = vec![0; 4096];
        memory.read(base, &mut bytes).ok()?;
        let image = Self(bytes);
        let mut length = 0;
        for segment in image.segments()? {
            // It is loaded from its beginning.
            if image.half(segment)? == 1 && image.word(segment + 16)? == 0 {
                length = image.word(segment + 40)?;
            }
        }
        let mut bytes = vec![0; Some(length).filter(|length| *length <= Self::MOST)?];
        memory.read(base, &mut bytes).ok()?;
        Some(Self(bytes))
    }

    fn word(&self, at: usize) -> Option<usize> {
        let bytes = self.0.get(at..at.checked_add(8)?)?;
        usize::try_from(u64::from_le_bytes(bytes.try_into().ok()?)).ok()
    }

    fn half(&self, at: usize) -> Option<usize> {
        let bytes = self.0.get(at..at.checked_add(4)?)?;
        usize::try_from(u32::from_le_bytes(bytes.try_into().ok()?)).ok()
    }

    /// Where the headers of its segments are.
    fn segments(&self) -> Option<Vec<usize>> {
        let is_elf = self.0.get(..5)? == b"\x7fELF\x02";
        let count = usize::from(*self.0.get(56).filter(|_| is_elf)?);
        let first = self.word(32).filter(|first| *first >= Self::HEADER)?;
        Some((0..count).map(|n| first + n * Self::SEGMENT).collect())
    }

    /// All that programs can find in it.
    fn functions(&self) -> Option<Vec<Function>> {
        let segments = self.segments()?;
        let dynamic = segments.into_iter().find(|at| self.half(*at) == Some(2))?;
        let dynamic = self.word(dynamic + 8)?;
        let (mut names, mut symbols) = (0, 0);
        for at in (dynamic..).step_by(16) {
            match self.word(at)? {
                0 => break,
                5 => names = self.word(at + 8)?,
                6 => symbols = self.word(at + 8)?,
                _ => {}
            }
        }
        // The kernel has the names behind the symbols.
        let all = (symbols..names).step_by(Self::SYMBOL).skip(1);
        let mut functions = Vec::new();
        for entry in all {
            let name = self.0.get(names + self.half(entry)?..)?;
            let name = name.split(|byte| *byte == 0).next()?;
            let symbol: [u8; 16] = self.0.get(entry..entry + 16)?.try_into().ok()?;
            // The low half of this byte is the kind: 2 is a function.
            if symbol[4] & 0xF == 2 {
                functions.push(Function {
                    entry,
                    symbol,
                    code: self.word(entry + 8)?,
                    length: self.word(entry + 16)?,
                    name: name.to_vec(),
                });
            }
        }
        Some(functions)
    }

    /// Some instruction `syscall`.
    fn call(&self) -> Option<usize> {
        self.0.windows(2).position(|two| two == [0x0F, 0x05])
    }
}

/// The vDSO of a program that has just been loaded.
pub(crate) struct Vdso {
    /// Address at which the program finds its own.
    entry: u64,
    base: u64,
    functions: Vec<Function>,
    /// Address at which its code begins, all of which is dead once its functions lead elsewhere.
    first: usize,
    /// Some instruction `syscall` in it.
    pub(crate) gate: u64,
}

impl Vdso {
    /// Looks at it; `None` if it is not as it should be, and then the program does not find it.
    pub(super) fn find(memory: Memory, entry: u64, base: u64) -> io::Result<Option<Self>> {
        let found = Image::read(memory, base).and_then(|image| {
            let functions = image.functions()?;
            let first = functions.iter().map(|one| one.code).min()?;
            let first = first.next_multiple_of(8);
            let ends = functions
                .iter()
                .map(|one| one.code.saturating_add(one.length));
            let room = ends.max()?.saturating_sub(first);
            Some(Self {
                entry,
                base,
                functions,
                first: Some(first).filter(|_| code(0).len() <= room)?,
                gate: base + image.call()? as u64,
            })
        });
        if found.is_none() {
            hide(memory, entry)?;
        }
        Ok(found)
    }

    /// The syscall with which the program asks for a page: its number and arguments.
    pub(crate) fn page_call() -> (i64, [u64; 6]) {
        let rights = libc::PROT_READ | libc::PROT_WRITE;
        let kind = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS;
        let [rights, kind] = [rights, kind].map(|bits| u64::from(bits.unsigned_abs()));
        (libc::SYS_mmap, [0, 4096, rights, kind, u64::MAX, 0])
    }

    /// Replaces the functions, now that the system has given this page; where it is. `None` if
    /// there is none, and then the program does not find the vDSO.
    pub(crate) fn replace(&self, tid: Tid, page: i64) -> io::Result<Option<u64>> {
        let page = u64::try_from(page).ok();
        let written = page.filter(|page| self.write(tid, *page).is_ok());
        if written.is_none() {
            hide(Memory(tid), self.entry)?;
        }
        Ok(written)
    }

    fn write(&self, tid: Tid, page: u64) -> io::Result<()> {
        sys::poke(tid, self.base + self.first as u64, &code(page))?;
        for function in &self.functions {
            let place = replacement(&function.name).map(|offset| self.first + offset);
            let mut symbol = function.symbol;
            if place.is_none() {
                // Of no section, which is to say that it is not there.
                symbol[6..8].fill(0);
            }
            symbol[8..].copy_from_slice(&(place.unwrap_or(0) as u64).to_le_bytes());
            sys::poke(tid, self.base + function.entry as u64, &symbol)?;
        }
        Ok(())
    }
}

/// Takes it out of what a program is given, so that it reads the time by a syscall.
fn hide(memory: Memory, entry: u64) -> io::Result<()> {
    const AT_IGNORE: u64 = 1;
    memory.write(entry, &AT_IGNORE.to_ne_bytes())
}

/// Writes what the clocks show into their page, and how often they may be read without a syscall.
pub(crate) fn write_clocks(
    memory: Memory,
    page: u64,
    queries: u32,
    (real, monotonic): (u64, u64),
) -> io::Result<()> {
    let (real_seconds, real_part) = parts(real);
    let (seconds, part) = parts(monotonic);
    let (_, micros) = parts_micros(real);
    let words = [
        queries.into(),
        real_seconds,
        real_part,
        seconds,
        part,
        micros,
    ];
    let mut bytes = [0; 48];
    for (to, word) in bytes.chunks_exact_mut(8).zip(words) {
        to.copy_from_slice(&word.to_ne_bytes());
    }
    memory.write(page, &bytes)
}
