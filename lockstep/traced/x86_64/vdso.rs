//! Clocks inside of a program, so that reading them takes no syscall.
//!
//! The vDSO is a small library that the kernel puts into each program and that reads the real
//! clock. Its functions are replaced by ones that read simulated time from a page of the program's
//! own memory, which the tracer writes before it resumes the program when time has passed. Whatever
//! else it has is taken out: programs make a syscall then, as they do where a kernel lacks it.
#![expect(
    unsafe_code,
    reason = "the address of what the assembler has made has no safe name"
)]

use std::arch::global_asm;
use std::io;

use elf::ElfBytes;
use elf::abi;
use elf::endian::LittleEndian;
use elf::file::Class;
use elf::string_table::StringTable;
use elf::symbol::{Symbol, SymbolTable};

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

/// Offset of the replacement of a vDSO function.
fn replacement(name: &[u8]) -> Option<usize> {
    let name = name.strip_prefix(b"__vdso_").unwrap_or(name);
    Some(match name {
        b"clock_gettime" => offset(&raw const sim_lockstep_clock_gettime),
        b"gettimeofday" => offset(&raw const sim_lockstep_gettimeofday),
        b"time" => offset(&raw const sim_lockstep_time),
        _ => return None,
    })
}

/// A function of the vDSO: where its symbol is, what that says, and its name.
struct Function {
    entry: u64,
    symbol: Symbol,
    name: Vec<u8>,
}

/// Reads the vDSO without assumptions.
fn read(memory: Memory, base: u64) -> io::Result<Vec<u8>> {
    const PAGE: usize = 4096;
    /// No kernel has one that is longer.
    const MOST: usize = 16;
    let mut image = vec![0; MOST * PAGE];
    let page = |at: usize| (base + (at * PAGE) as u64, PAGE as u64);
    let pages: Vec<(u64, u64)> = (0..MOST).map(page).collect();
    let length = sys::read_memory(memory.0, &pages, &mut image)?;
    image.truncate(length);
    Ok(image)
}

/// All functions that programs can find in it.
fn functions(image: &[u8]) -> Option<Vec<Function>> {
    /// The length of a symbol.
    const SYMBOL: usize = 24;
    let elf = ElfBytes::<LittleEndian>::minimal_parse(image).ok()?;
    let dynamic = elf.dynamic().ok()??;
    let find = |tag| dynamic.iter().find(|one| one.d_tag == tag);
    let [symbols, names] =
        [abi::DT_SYMTAB, abi::DT_STRTAB].map(|tag| find(tag).map(|one| one.d_ptr()));
    let place = |at: u64| usize::try_from(at).ok();
    // The kernel has the names behind the symbols.
    let table = image.get(place(symbols?)?..place(names?)?)?;
    let table = SymbolTable::new(LittleEndian, Class::ELF64, table);
    let names = StringTable::new(image.get(place(names?)?..)?);
    let entries = (symbols?..).step_by(SYMBOL).zip(table.iter());
    let functions = entries.filter(|(_, symbol)| symbol.st_symtype() == abi::STT_FUNC);
    functions
        .map(|(entry, symbol)| {
            let name = names.get_raw(place(symbol.st_name.into())?).ok()?.to_vec();
            Some(Function {
                entry,
                symbol,
                name,
            })
        })
        .collect()
}

/// The vDSO of a program that has just been loaded.
pub(crate) struct Vdso {
    /// Address at which the program finds its own.
    entry: u64,
    base: u64,
    functions: Vec<Function>,
    /// Where its code begins, all of which is dead once its functions lead elsewhere.
    first: u64,
    /// Some instruction `syscall` in it.
    pub(crate) gate: u64,
}

impl Vdso {
    /// Finds it; `None` if it is not as expected, and then the program does not find it either.
    pub(super) fn find(memory: Memory, entry: u64, base: u64) -> io::Result<Option<Self>> {
        let found = read(memory, base).ok().and_then(|image| {
            let functions = functions(&image)?;
            let symbols = || functions.iter().map(|one| &one.symbol);
            let first = symbols().map(|one| one.st_value).min()?.next_multiple_of(8);
            let ends = symbols().map(|one| one.st_value.saturating_add(one.st_size));
            let end = ends.max()?;
            let [from, to] = [first, end].map(|at| usize::try_from(at).unwrap_or(usize::MAX));
            let old = image
                .get(from..to)
                .filter(|old| code(0).len() <= old.len())?;
            let call = old.windows(2).position(|two| two == [0x0F, 0x05])?;
            Some(Self {
                entry,
                base,
                first,
                functions,
                gate: base + first + call as u64,
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

    /// Replaces the functions, with this new page for the clocks. `None` if there is no page, and then the program
    /// does not find the vDSO.
    pub(crate) fn replace(&self, tid: Tid, page: i64) -> io::Result<Option<u64>> {
        let page = u64::try_from(page).ok();
        let written = page.filter(|page| self.write(tid, *page).is_ok());
        if written.is_none() {
            hide(Memory(tid), self.entry)?;
        }
        Ok(written)
    }

    fn write(&self, tid: Tid, page: u64) -> io::Result<()> {
        sys::poke(tid, self.base + self.first, &code(page))?;
        for Function {
            entry,
            symbol,
            name,
        } in &self.functions
        {
            let offset = replacement(name);
            // Section 0 marks it as undefined.
            let section = offset.map_or(abi::SHN_UNDEF, |_| symbol.st_shndx);
            let place = offset.map_or(0, |offset| self.first + offset as u64);
            let mut bytes = symbol.st_name.to_le_bytes().to_vec();
            bytes.extend([symbol.st_info, symbol.st_other]);
            bytes.extend(section.to_le_bytes());
            bytes.extend(place.to_le_bytes());
            sys::poke(tid, self.base + entry, &bytes)?;
        }
        Ok(())
    }
}

/// Removes it from a program's auxiliary vector, so that the program reads the time by a syscall.
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
