//! The `mcp` subcommand: a server of the Model Context Protocol on standard input and output.
//!
//! A tool is a command line of this program, by the table in `mcp/tools.json`; its output is the answer. Of
//! the protocol it needs four methods, for which a library would make the program larger by a sixth.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufRead as _, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use rigsim_core::device::Devices;
use rustix::process::{Pid, Signal, kill_process};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use tempfile::TempDir;

use crate::exit::{Exit, Failure};

const TOOLS: &str = include_str!("mcp/tools.json");
/// Versions of the protocol whose methods are the same here; the newest is the first.
const VERSIONS: [&str; 4] = ["2025-11-25", "2025-06-18", "2025-03-26", "2024-11-05"];
/// Most bytes of a request.
const MOST_REQUEST: u64 = 1 << 20;
/// Most characters of an answer, at its beginning and at its end.
const MOST_SHOWN: usize = 6000;
/// Most calls at a time.
const MOST_CALLS: usize = 8;
/// Time within which a simulator has to be there.
const START: Duration = Duration::from_secs(20);
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

impl Tool {
    fn shown(&self) -> Value {
        json!({
            "name": self.name,
            "description": self.description,
            "inputSchema": {"type": "object", "properties": self.arguments, "required": self.required},
        })
    }

    /// The arguments by name, each as its words.
    fn read(&self, given: &Value) -> Result<BTreeMap<&str, Vec<String>>, String> {
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
                (Some("array"), Value::Array(words)) => words
                    .iter()
                    .map(|word| word.as_str().map(str::to_owned))
                    .collect(),
                _ => None,
            };
            let words =
                words.ok_or_else(|| format!("`{name}` is of the type {}", schema["type"]))?;
            read.insert(name.as_str(), words);
        }
        Ok(read)
    }

    fn words(&self, arguments: &BTreeMap<&str, Vec<String>>, output: &Path) -> Vec<String> {
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
        end(self.simulator.id());
        self.simulator.wait()?;
        fs::read_to_string(&self.log)
    }
}

struct Server {
    devices: Devices,
    tools: Vec<Tool>,
    folder: TempDir,
    /// Programs that run for a call, by the id of its request.
    running: Mutex<BTreeMap<String, u32>>,
    live: Mutex<Option<Live>>,
}

/// Serves until its input ends.
pub(crate) fn serve(devices: Devices) -> Result<Exit, Failure> {
    let folder = tempfile::Builder::new().prefix("sim-mcp-").tempdir();
    let server = Server {
        devices,
        tools: serde_json::from_str(TOOLS).map_err(Failure::system)?,
        folder: folder.map_err(Failure::system)?,
        running: Mutex::default(),
        live: Mutex::default(),
    };
    let served = thread::scope(|scope| {
        let mut input = io::stdin().lock();
        loop {
            let mut line = Vec::new();
            if input
                .by_ref()
                .take(MOST_REQUEST)
                .read_until(b'\n', &mut line)?
                == 0
            {
                break;
            }
            let Ok(request) = serde_json::from_slice::<Value>(&line) else {
                say(
                    &Value::Null,
                    Err((
                        -32700,
                        "a request is a line of JSON, of 1 MiB at most".into(),
                    )),
                )?;
                continue;
            };
            let (id, params) = (request["id"].clone(), request["params"].clone());
            match request["method"].as_str().unwrap_or_default() {
                "notifications/cancelled" => {
                    let running = lock(&server.running);
                    let pid = running.get(&params["requestId"].to_string());
                    pid.copied().into_iter().for_each(end);
                }
                _ if id.is_null() => {}
                "tools/call" if lock(&server.running).len() >= MOST_CALLS => {
                    say(&id, Err((-32603, "too many calls at a time".into())))?;
                }
                "tools/call" => {
                    let server = &server;
                    scope.spawn(move || say(&id, server.call(&id, &params)));
                }
                method => say(&id, server.answer(method, &params))?,
            }
        }
        lock(&server.running).values().copied().for_each(end);
        Ok::<(), io::Error>(())
    });
    if let Some(live) = lock(&server.live).take() {
        live.stop().map_err(Failure::system)?;
    }
    served.map(|()| Exit::Clean).map_err(Failure::system)
}

type Answer = Result<Value, (i32, String)>;

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

impl Server {
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

    fn call(&self, id: &Value, params: &Value) -> Answer {
        let name = params["name"].as_str().unwrap_or_default();
        let Some(tool) = self.tools.iter().find(|tool| tool.name == name) else {
            return Err((-32602, format!("no tool is called `{name}`")));
        };
        let arguments = tool
            .read(&params["arguments"])
            .map_err(|why| (-32602, why))?;
        let done = self.carry_out(tool, &arguments, id);
        let (is_good, text) = done.unwrap_or_else(|error| (false, error.to_string()));
        let text = format!(
            "{}\n\nNext: {}",
            shortened(text.trim_end()),
            tool.next[usize::from(!is_good)]
        );
        Ok(json!({"content": [{"type": "text", "text": text}], "isError": !is_good}))
    }

    /// Says whether it went well, and what there is to say.
    fn carry_out(
        &self,
        tool: &Tool,
        arguments: &BTreeMap<&str, Vec<String>>,
        id: &Value,
    ) -> io::Result<(bool, String)> {
        let output = self
            .folder
            .path()
            .join(id.to_string().replace(['"', '/'], ""));
        let words = tool.words(arguments, &output);
        let matching = arguments.get("matching").and_then(|words| words.first());
        match tool.name.as_str() {
            "start" => return self.start(&words, &output, id),
            "stop" => {
                let log = lock(&self.live).take().map(Live::stop).transpose()?;
                return Ok((
                    log.is_some(),
                    log.unwrap_or_else(|| "no simulator was started".to_owned()),
                ));
            }
            "list" if words[0] == "devices" => {
                let devices = self
                    .devices
                    .iter()
                    .map(|device| format!("{}: {}", device.id, device.about));
                return Ok((true, devices.collect::<Vec<_>>().join("\n")));
            }
            _ => {}
        }
        let (is_good, mut text) = self.sim(&words, id)?;
        if tool.name == "explain" && is_good {
            text = explained(&text);
        }
        if let Some(matching) = matching {
            // What follows a heading is indented; comments stand above a setting.
            let gap = if text.contains("\n\n") { "\n\n" } else { "\n" };
            let joined = text.replace("\n  ", "\r  ");
            let parts = joined.split(gap).filter(|part| part.contains(matching));
            text = parts.collect::<Vec<_>>().join(gap).replace('\r', "\n");
        }
        Ok((is_good, text))
    }

    /// Runs this program; says whether it went well, and what it printed.
    fn sim(&self, words: &[String], id: &Value) -> io::Result<(bool, String)> {
        let url = lock(&self.live).as_ref().map(|live| live.url.clone());
        let program = Command::new(std::env::current_exe()?)
            .args(words)
            .envs(url.map(|url| ("SIM_CONTROL", url)))
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()?;
        lock(&self.running).insert(id.to_string(), program.id());
        let ended = program.wait_with_output();
        lock(&self.running).remove(&id.to_string());
        let ended = ended?;
        let text = [ended.stdout, ended.stderr].concat();
        Ok((
            ended.status.success(),
            String::from_utf8_lossy(&text).into_owned(),
        ))
    }

    fn start(&self, words: &[String], output: &Path, id: &Value) -> io::Result<(bool, String)> {
        if let Some(live) = lock(&self.live).take() {
            live.stop()?;
        }
        let log = output.with_extension("log");
        let out = File::create(&log)?;
        let mut command = Command::new(std::env::current_exe()?);
        command
            .args(words)
            .stdin(Stdio::null())
            .stderr(out.try_clone()?)
            .stdout(out);
        let mut simulator = command.spawn()?;
        let begun = Instant::now();
        while !Path::new(&format!("{}-ready", output.display())).exists() {
            if simulator.try_wait()?.is_some() || begun.elapsed() > START {
                end(simulator.id());
                simulator.wait()?;
                return Ok((false, fs::read_to_string(&log)?));
            }
            thread::sleep(Duration::from_millis(10));
        }
        let text = fs::read_to_string(&log)?;
        let url = text
            .lines()
            .find_map(|line| line.trim().strip_prefix("control on "));
        let url = url.unwrap_or_default().to_owned();
        *lock(&self.live) = Some(Live {
            simulator,
            url,
            log,
        });
        let (is_good, why) = self.sim(&["ctl".to_owned(), "pause".to_owned()], id)?;
        Ok((is_good, if is_good { text } else { why }))
    }
}

/// Failures of a trace, and what came just before the first of them.
fn explained(trace: &str) -> String {
    let lines = trace
        .lines()
        .filter_map(|line| serde_json::from_str(line).ok());
    let lines: Vec<Value> = lines.collect();
    let show = |line: &Value| {
        let [code, text, device] =
            ["code", "text", "device"].map(|key| line[key].as_str().unwrap_or_default());
        format!(
            "{:.3} s {device} {text} [{code}]\n",
            line["time_s"].as_f64().unwrap_or_default()
        )
    };
    let is_failure = |line: &&Value| line["code"] == "failure";
    let failures: String = lines.iter().filter(is_failure).map(show).collect();
    let first = lines.iter().position(|line| line["code"] == "failure");
    let before = |is_traffic: bool, count: usize| -> String {
        let before = &lines[..first.unwrap_or(lines.len())];
        let before = before
            .iter()
            .filter(|line| (line["level"] == "traffic") == is_traffic);
        let before: Vec<String> = before.map(show).collect();
        before[before.len().saturating_sub(count)..].concat()
    };
    let failures = first.map_or("nothing failed\n".to_owned(), |_| failures);
    let (events, frames) = (before(false, 12), before(true, 8));
    format!("{failures}\nWhat happened before:\n{events}\nThe last frames before:\n{frames}")
}

/// The beginning and the end of a long text.
fn shortened(text: &str) -> String {
    let count = text.chars().count();
    if count <= 2 * MOST_SHOWN {
        return text.to_owned();
    }
    let left = count - 2 * MOST_SHOWN;
    let begin: String = text.chars().take(MOST_SHOWN).collect();
    let end: String = text.chars().skip(MOST_SHOWN + left).collect();
    format!("{begin}\n… {left} characters are left out …\n{end}")
}
