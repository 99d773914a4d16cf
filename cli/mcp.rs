//! The `mcp` subcommand: a server of the Model Context Protocol on standard input and output.
//!
//! A tool is a command line of this program, by the table in `mcp/tools.json`; its output is the answer. Of
//! the protocol it needs four methods. A library would save about a quarter of this file, by a sketch, and
//! bring an asynchronous runtime.

use std::collections::{BTreeMap, VecDeque};
use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Read as _, Write as _};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, Scope};
use std::time::{Duration, Instant};

use rigsim_core::device::Devices;
use rustix::process::{Pid, Signal, kill_process};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;
use tempfile::TempDir;

use crate::exit::{Exit, Failure};

const TOOLS: &str = include_str!("mcp/tools.json");
/// Versions of the protocol whose methods are the same here; the newest is the first. The one that is
/// missing between them has batches.
const VERSIONS: [&str; 3] = ["2025-11-25", "2025-06-18", "2024-11-05"];
/// Most bytes of a request, and of a line of output.
const MOST_LINE: u64 = 1 << 20;
/// Most bytes of an answer, at its beginning and at its end.
const MOST_SHOWN: usize = 6000;
/// Most calls at a time.
const MOST_CALLS: usize = 8;
/// Most failures, and most events and frames before the first, that are explained.
const MOST_FAILURES: usize = 30;
const MOST_BEFORE: [usize; 2] = [12, 8];
/// Time within which a simulator has to be there.
const START: Duration = Duration::from_secs(20);
/// Time that is left to programs when a signal ends the server.
const END: Duration = Duration::from_secs(5);
const INSTRUCTIONS: &str = "Tests a program that drives a vehicle over a serial port, the client, against \
    simulated vehicles. Begin with `list`, write a scenario file, `check` it, `run` it with the client, and \
    `explain` a failure. `hunt` searches for faults that break the client. `start` serves a vehicle that \
    `control` breaks and moves step by step.";

#[derive(Deserialize)]
struct Tool {
    name: String,
    description: String,
    arguments: Map<String, Value>,
    required: Vec<String>,
    /// Words, left out together if one of them is an argument that is not given.
    command: Vec<Vec<String>>,
    /// What to do after success and after failure.
    next: [String; 2],
}

/// Arguments by name, each as its words.
type Arguments<'a> = BTreeMap<&'a str, Vec<String>>;

impl Tool {
    fn shown(&self) -> Value {
        json!({
            "name": self.name,
            "description": self.description,
            "inputSchema": {"type": "object", "properties": self.arguments, "required": self.required},
        })
    }

    fn read(&self, given: &Value) -> Result<Arguments<'_>, String> {
        let none = Map::new();
        let given = given.as_object().unwrap_or(&none);
        if let Some(unknown) = given
            .keys()
            .find(|name| !self.arguments.contains_key(*name))
        {
            let known: Vec<&str> = self.arguments.keys().map(String::as_str).collect();
            return Err(format!(
                "no argument is called `{unknown}`; allowed: {}",
                known.join(", ")
            ));
        }
        let mut read = BTreeMap::new();
        for (name, schema) in &self.arguments {
            let Some(value) = given.get(name).or(schema.get("default")) else {
                if self.required.contains(name) {
                    return Err(format!("`{name}` is missing: {}", schema["description"]));
                }
                continue;
            };
            let words = match (schema["type"].as_str(), value) {
                (Some("string"), Value::String(word)) => Some(vec![word.clone()]),
                (Some("integer"), Value::Number(number)) => Some(vec![number.to_string()]),
                (Some("array"), words) => serde_json::from_value(words.clone()).ok(),
                _ => None,
            };
            let words =
                words.ok_or_else(|| format!("`{name}` is of the type {}", schema["type"]))?;
            let allowed = schema["enum"].as_array();
            if allowed.is_some_and(|allowed| !allowed.contains(value)) {
                return Err(format!("`{name}` is one of {}", schema["enum"]));
            }
            read.insert(name.as_str(), words);
        }
        Ok(read)
    }

    fn words(&self, arguments: &Arguments<'_>, output: &Path) -> Vec<String> {
        let mut words = Vec::new();
        for group in &self.command {
            let mut filled = Vec::new();
            let is_whole = group.iter().all(|word| {
                let word = word.replace("{output}", &output.to_string_lossy());
                let name = word
                    .strip_prefix('{')
                    .and_then(|word| word.strip_suffix('}'));
                let Some(name) = name else {
                    filled.push(word);
                    return true;
                };
                let each = name.strip_prefix("each ");
                let Some(given) = arguments
                    .get(each.unwrap_or(name))
                    .filter(|given| !given.is_empty())
                else {
                    return false;
                };
                for (index, word) in given.iter().enumerate() {
                    if index > 0 && each.is_some() {
                        filled.extend(group.first().cloned());
                    }
                    // A file is no flag; what stands for a whole command line has flags.
                    let is_flag = word.starts_with('-') && !matches!(name, "client" | "words");
                    filled.push(if is_flag {
                        format!("./{word}")
                    } else {
                        word.clone()
                    });
                }
                true
            });
            if is_whole {
                words.append(&mut filled);
            }
        }
        words
    }
}

/// A simulator that was started.
struct Live {
    simulator: Child,
    url: String,
    log: PathBuf,
}

impl Live {
    fn stop(mut self) -> io::Result<String> {
        // The number of one that has ended may be another program's by now.
        if self.simulator.try_wait()?.is_none() {
            end(self.simulator.id());
            self.simulator.wait()?;
        }
        fs::read_to_string(&self.log)
    }
}

/// Calls that are not answered yet, by the ids of their requests.
struct Calls {
    /// Most of them; 0 when the server ends.
    most: usize,
    /// Number of the newest one.
    number: u64,
    open: BTreeMap<String, Call>,
}

#[derive(Default)]
struct Call {
    /// The program that runs for it.
    program: Option<u32>,
    is_cancelled: bool,
}

impl Call {
    fn cancel(&mut self) {
        self.is_cancelled = true;
        self.program.into_iter().for_each(end);
    }
}

struct Server {
    devices: Devices,
    tools: Vec<Tool>,
    folder: TempDir,
    calls: Mutex<Calls>,
    call_ended: Condvar,
    /// Locked for as long as one is being started.
    live: Mutex<Option<Live>>,
}

/// Serves until its input ends, or a signal comes.
pub(crate) fn serve(devices: Devices) -> Result<Exit, Failure> {
    let folder = tempfile::Builder::new().prefix("sim-mcp-").tempdir();
    let server = Server {
        devices,
        tools: serde_json::from_str(TOOLS).map_err(Failure::system)?,
        folder: folder.map_err(Failure::system)?,
        calls: Mutex::new(Calls {
            most: MOST_CALLS,
            number: 0,
            open: BTreeMap::new(),
        }),
        call_ended: Condvar::new(),
        live: Mutex::default(),
    };
    let mut signals = Signals::new([SIGHUP, SIGINT, SIGTERM]).map_err(Failure::system)?;
    let handle = signals.handle();
    thread::scope(|scope| {
        scope.spawn(|| {
            for signal in signals.forever() {
                // It ends anyway; what cannot be removed stays.
                let _ = server
                    .end()
                    .and_then(|()| fs::remove_dir_all(server.folder.path()));
                let _ = emulate_default_handler(signal);
            }
        });
        let served = server.serve(scope);
        let ended = server.end();
        handle.close();
        served.and(ended)
    })
    .map(|()| Exit::Clean)
    .map_err(Failure::system)
}

/// Code and message.
type Error = (i32, String);
type Answer = Result<Value, Error>;

fn say(id: &Value, answer: Answer) -> io::Result<()> {
    let message = match answer {
        Ok(result) => json!({"jsonrpc": "2.0", "id": id, "result": result}),
        Err((code, message)) => {
            json!({"jsonrpc": "2.0", "id": id, "error": {"code": code, "message": message}})
        }
    };
    let mut out = io::stdout().lock();
    writeln!(out, "{message}")?;
    out.flush()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn end(pid: u32) {
    let pid = i32::try_from(pid).ok().and_then(Pid::from_raw);
    // It may have ended by itself.
    let _ = pid.map(|pid| kill_process(pid, Signal::TERM));
}

/// The next line, cut to its limit; `None` at the end.
fn read_line(input: &mut impl BufRead) -> io::Result<Option<Vec<u8>>> {
    let mut line = Vec::new();
    let read = input.take(MOST_LINE).read_until(b'\n', &mut line)?;
    if read as u64 == MOST_LINE && !line.ends_with(b"\n") {
        input.skip_until(b'\n')?;
    }
    Ok((read > 0).then_some(line))
}

impl Server {
    fn serve<'s>(&'s self, scope: &'s Scope<'s, '_>) -> io::Result<()> {
        let mut input = io::stdin().lock();
        while let Some(line) = read_line(&mut input)? {
            let Ok(request) = serde_json::from_slice::<Value>(&line) else {
                let why = "a request is a line of JSON, of 1 MiB at most".to_owned();
                say(&Value::Null, Err((-32700, why)))?;
                continue;
            };
            let (id, params) = (request["id"].clone(), request["params"].clone());
            match request["method"].as_str().unwrap_or_default() {
                "notifications/cancelled" => {
                    let call = &params["requestId"].to_string();
                    lock(&self.calls).open.get_mut(call).map(Call::cancel);
                }
                _ if id.is_null() => {}
                "tools/call" => match self.begin(&id, &params) {
                    Ok((number, tool, arguments)) => drop(scope.spawn(move || {
                        let answer = self.call(number, tool, &arguments, &id);
                        match self.close(&id) {
                            true => Ok(()),
                            false => say(&id, Ok(answer)),
                        }
                    })),
                    Err(error) => say(&id, Err(error))?,
                },
                method => say(&id, self.answer(method, &params))?,
            }
        }
        Ok(())
    }

    /// Reads a call and notes it, with a number.
    fn begin(&self, id: &Value, params: &Value) -> Result<(u64, &Tool, Arguments<'_>), Error> {
        let name = params["name"].as_str().unwrap_or_default();
        let tool = self.tools.iter().find(|tool| tool.name == name);
        let tool = tool.ok_or_else(|| (-32602, format!("no tool is called `{name}`")))?;
        let arguments = tool
            .read(&params["arguments"])
            .map_err(|why| (-32602, why))?;
        let mut calls = lock(&self.calls);
        let refused = |why: &str| Err((-32603, why.to_owned()));
        if calls.open.len() >= calls.most {
            return refused("too many calls at a time");
        }
        if calls.open.contains_key(&id.to_string()) {
            return refused("a call with this id is not answered yet");
        }
        calls.open.insert(id.to_string(), Call::default());
        calls.number += 1;
        Ok((calls.number, tool, arguments))
    }

    /// Removes a call, and returns whether it was cancelled.
    fn close(&self, id: &Value) -> bool {
        let call = lock(&self.calls).open.remove(&id.to_string());
        self.call_ended.notify_all();
        call.is_none_or(|call| call.is_cancelled)
    }

    /// Ends all programs, and waits for them.
    fn end(&self) -> io::Result<()> {
        let mut calls = lock(&self.calls);
        calls.most = 0;
        calls.open.values_mut().for_each(Call::cancel);
        let ended = self
            .call_ended
            .wait_timeout_while(calls, END, |calls| !calls.open.is_empty());
        drop(ended);
        lock(&self.live)
            .take()
            .map_or(Ok(()), |live| live.stop().map(drop))
    }

    /// Answers what is no call of a tool.
    fn answer(&self, method: &str, params: &Value) -> Answer {
        match method {
            "initialize" => {
                let wanted = params["protocolVersion"].as_str();
                let known = VERSIONS.iter().find(|version| Some(**version) == wanted);
                Ok(json!({
                    "protocolVersion": known.unwrap_or(&VERSIONS[0]),
                    "capabilities": {"tools": {}},
                    "serverInfo": {"name": "sim", "version": env!("CARGO_PKG_VERSION")},
                    "instructions": INSTRUCTIONS,
                }))
            }
            "ping" => Ok(json!({})),
            "tools/list" => {
                Ok(json!({"tools": self.tools.iter().map(Tool::shown).collect::<Vec<_>>()}))
            }
            _ => Err((-32601, format!("no method is called `{method}`"))),
        }
    }

    fn call(&self, number: u64, tool: &Tool, arguments: &Arguments<'_>, id: &Value) -> Value {
        let output = self.folder.path().join(number.to_string());
        let mut shown = Excerpt::default();
        let done = self.carry_out(tool, arguments, &output, id, &mut shown);
        let is_good = done.unwrap_or_else(|error| {
            shown.add(&error.to_string());
            false
        });
        let next = &tool.next[usize::from(!is_good)];
        let text = format!("{}\n\nNext: {next}", shown.text().trim_end());
        json!({"content": [{"type": "text", "text": text}], "isError": !is_good})
    }

    /// Adds what there is to say, and returns whether it went well.
    fn carry_out(
        &self,
        tool: &Tool,
        arguments: &Arguments<'_>,
        output: &Path,
        id: &Value,
        shown: &mut Excerpt,
    ) -> io::Result<bool> {
        let words = tool.words(arguments, output);
        match tool.name.as_str() {
            "start" => self.start(&words, output, id, shown),
            "stop" => {
                let log = lock(&self.live).take().map(Live::stop).transpose()?;
                shown.add(log.as_deref().unwrap_or("no simulator was started"));
                Ok(log.is_some())
            }
            "list" if words[0] == "devices" => {
                let devices = self.devices.iter();
                devices.for_each(|one| shown.add(&format!("{}: {}\n", one.id, one.about)));
                Ok(true)
            }
            "list" => {
                let mut text = String::new();
                let is_good = self.sim(&words, None, id, &mut |line| text.push_str(line))?;
                let matching = arguments.get("matching").and_then(|words| words.first());
                if let Some(matching) = matching {
                    // What follows a heading is indented; comments stand above a setting.
                    let gap = if text.contains("\n\n") { "\n\n" } else { "\n" };
                    let joined = text.replace("\n  ", "\r  ");
                    let parts = joined.split(gap).filter(|part| part.contains(matching));
                    text = parts.collect::<Vec<_>>().join(gap).replace('\r', "\n");
                }
                shown.add(&text);
                Ok(is_good)
            }
            "explain" => {
                let mut explained = Explanation::default();
                let mut keep = |line: &str| match serde_json::from_str(line) {
                    Ok(line) => explained.add(&line),
                    Err(_) => shown.add(line),
                };
                let is_good = self.sim(&words, None, id, &mut keep)?;
                shown.add(&explained.text());
                Ok(is_good)
            }
            "control" => {
                let url = lock(&self.live).as_ref().map(|live| live.url.clone());
                self.sim(&words, url.as_deref(), id, &mut |line| shown.add(line))
            }
            _ => self.sim(&words, None, id, &mut |line| shown.add(line)),
        }
    }

    /// Starts this program for a call.
    fn spawn(
        &self,
        words: &[String],
        url: Option<&str>,
        out: OwnedFd,
        id: &Value,
    ) -> io::Result<Child> {
        let program = Command::new(std::env::current_exe()?)
            .args(words)
            .env_remove("SIM_CONTROL")
            .envs(url.map(|url| ("SIM_CONTROL", url)))
            .stdin(Stdio::null())
            .stderr(out.try_clone()?)
            .stdout(out)
            .spawn()?;
        if let Some(call) = lock(&self.calls).open.get_mut(&id.to_string()) {
            call.program = Some(program.id());
            if call.is_cancelled {
                call.cancel();
            }
        }
        Ok(program)
    }

    /// Notes that no program runs for a call, so that none is ended for it.
    fn leave(&self, id: &Value) {
        if let Some(call) = lock(&self.calls).open.get_mut(&id.to_string()) {
            call.program = None;
        }
    }

    /// Runs this program, hands on each line that it prints, and says whether it went well.
    fn sim(
        &self,
        words: &[String],
        url: Option<&str>,
        id: &Value,
        keep: &mut dyn FnMut(&str),
    ) -> io::Result<bool> {
        let (reader, out) = io::pipe()?;
        let mut program = self.spawn(words, url, out.into(), id)?;
        let mut reader = BufReader::new(reader);
        while let Some(line) = read_line(&mut reader)? {
            keep(&String::from_utf8_lossy(&line));
        }
        self.leave(id);
        Ok(program.wait()?.success())
    }

    fn start(
        &self,
        words: &[String],
        output: &Path,
        id: &Value,
        shown: &mut Excerpt,
    ) -> io::Result<bool> {
        let mut live = lock(&self.live);
        if let Some(live) = live.take() {
            live.stop()?;
        }
        let log = output.with_extension("log");
        let out = File::create(&log)?;
        let mut started = Live {
            simulator: self.spawn(words, None, out.into(), id)?,
            url: String::new(),
            log,
        };
        let begun = Instant::now();
        let text = loop {
            let text = fs::read_to_string(&started.log)?;
            if text.lines().any(|line| line == "ready") {
                break text;
            }
            if started.simulator.try_wait()?.is_some() || begun.elapsed() > START {
                self.leave(id);
                shown.add(&started.stop()?);
                return Ok(false);
            }
            thread::sleep(Duration::from_millis(10));
        };
        self.leave(id);
        let mut lines = text.lines();
        let url = lines.find_map(|line| line.trim().strip_prefix("control on "));
        started.url = url.unwrap_or_default().to_owned();
        shown.add(&text);
        let started = live.insert(started);
        let pause = ["ctl".to_owned(), "pause".to_owned()];
        self.sim(&pause, Some(&started.url), id, &mut |line| shown.add(line))
    }
}

/// Failures of a trace, and what came just before the first of them.
#[derive(Default)]
struct Explanation {
    failures: Vec<String>,
    /// Events and frames.
    before: [VecDeque<String>; 2],
}

impl Explanation {
    fn add(&mut self, line: &Value) {
        let [code, text, device] =
            ["code", "text", "device"].map(|key| line[key].as_str().unwrap_or_default());
        let time = line["time_s"].as_f64().unwrap_or_default();
        let shown = format!("{time:.3} s {device} {text} [{code}]\n");
        let kind = usize::from(line["level"] == "traffic");
        if code == "failure" && self.failures.len() < MOST_FAILURES {
            self.failures.push(shown);
        } else if self.failures.is_empty() {
            let before = &mut self.before[kind];
            before.push_back(shown);
            before.drain(..before.len().saturating_sub(MOST_BEFORE[kind]));
        }
    }

    fn text(mut self) -> String {
        if self.failures.is_empty() {
            self.failures.push("nothing failed\n".to_owned());
        }
        let failures = self.failures.concat();
        let [events, frames] = self.before.map(|lines| Vec::from(lines).concat());
        format!("{failures}\nWhat happened before:\n{events}\nThe last frames before:\n{frames}")
    }
}

/// The beginning and the end of a long text.
#[derive(Default)]
struct Excerpt {
    text: String,
    left_out: usize,
}

impl Excerpt {
    fn add(&mut self, text: &str) {
        self.text.push_str(text);
        if self.text.len() > 4 * MOST_SHOWN {
            self.cut();
        }
    }

    fn cut(&mut self) {
        let ends = [MOST_SHOWN, self.text.len().saturating_sub(MOST_SHOWN)];
        let [begin, end] = ends.map(|at| self.text.floor_char_boundary(at));
        if begin < end {
            self.text.drain(begin..end);
            self.left_out += end - begin;
        }
    }

    fn text(mut self) -> String {
        self.cut();
        if self.left_out > 0 {
            let middle = self.text.floor_char_boundary(MOST_SHOWN);
            let words = format!("\n… {} bytes are left out …\n", self.left_out);
            self.text.insert_str(middle, &words);
        }
        self.text
    }
}
