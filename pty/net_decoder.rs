//! Protocol with a client on the network, without any input or output.

use rigsim_settings::ClientLine;
use std::collections::VecDeque;

use rfc2217::{FlowControl, ModemState, PortSettings, Progress, Purge, Server, ServerEvent};

/// Protocol of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// As they are. The client cannot set the line.
    Tcp,
    /// With the settings and lines of a serial port, RFC 2217.
    Rfc2217,
}

/// Bytes kept ahead of the line, as many as drivers of serial ports keep.
pub(crate) const MOST_AHEAD: usize = 4096;
/// Bytes taken at once for a client without a protocol.
const PLAIN_PIECE: usize = 256;

/// One end of a connection: bytes for the device, and with RFC 2217 settings and lines of its port.
#[derive(Debug)]
pub struct NetDecoder {
    /// `None` where all are bytes for the device.
    server: Option<Server>,
    /// Bytes for a client without a protocol.
    plain: Vec<u8>,
    settings: PortSettings,
    lines: ModemState,
}

impl NetDecoder {
    /// At the beginning of a connection, with the line set as a device at `baud` has it.
    #[must_use]
    pub fn new(protocol: Protocol, baud: u32) -> Self {
        let settings = PortSettings {
            baud_rate: baud,
            ..PortSettings::default()
        };
        let server = Server::new(settings).with_signature("sim");
        let mut decoder = Self {
            server: (protocol == Protocol::Rfc2217).then_some(server),
            plain: Vec::new(),
            settings,
            lines: ModemState::DSR | ModemState::CD | ModemState::CTS,
        };
        decoder.send_lines();
        decoder
    }

    /// Takes of `input` what there is room for, adds what it has for the device to `ahead`, of
    /// which never more than 4096 and one are kept, and says how much of it was taken. With output
    /// waiting it may be nothing.
    pub fn take(&mut self, input: &[u8], ahead: &mut VecDeque<u8>) -> usize {
        let room = MOST_AHEAD.saturating_sub(ahead.len());
        if room == 0 {
            return 0;
        }
        let Some(server) = &mut self.server else {
            let count = input.len().min(room);
            ahead.extend(&input[..count]);
            return count;
        };
        let mut payload = [0; 256];
        let most = room.min(payload.len());
        let Progress {
            consumed,
            payload_len,
            ..
        } = server.receive_into(input, &mut payload[..most]);
        ahead.extend(&payload[..payload_len]);
        while let Some(event) = self.server.as_mut().and_then(Server::poll_event) {
            self.act(&event, ahead);
        }
        consumed
    }

    /// Takes of the device's bytes what there is room for; says how much.
    pub fn put(&mut self, bytes: &[u8]) -> usize {
        match &mut self.server {
            Some(server) => server.try_write_data(bytes).unwrap_or(0),
            None if self.plain.is_empty() => {
                let count = bytes.len().min(PLAIN_PIECE);
                self.plain.extend(&bytes[..count]);
                count
            }
            None => 0,
        }
    }

    /// Bytes for the client.
    #[must_use]
    pub fn output(&self) -> &[u8] {
        match &self.server {
            Some(server) => server.output(),
            None => &self.plain,
        }
    }

    /// So much of that was sent.
    pub fn consume_output(&mut self, count: usize) {
        match &mut self.server {
            Some(server) => server.consume_output(count),
            None => drop(self.plain.drain(..count.min(self.plain.len()))),
        }
    }

    /// Settings of the port by the client.
    #[must_use]
    pub fn settings(&self) -> ClientLine {
        let asked = &self.settings;
        ClientLine {
            baud: asked.baud_rate,
            parity: asked.parity != rfc2217::Parity::None,
            stop_bits: match asked.stop_bits {
                rfc2217::StopBits::One => 1,
                _ => 2,
            },
            rts_cts: asked.flow_control == FlowControl::RtsCts,
            raw: true,
        }
    }

    fn act(&mut self, event: &ServerEvent, ahead: &mut VecDeque<u8>) {
        match event {
            ServerEvent::SettingsChanged(settings) => self.settings = *settings,
            ServerEvent::Purge(Purge::Transmit | Purge::Both) => ahead.clear(),
            // A receiver takes a line that stays low for a byte 0 whose stop bit is wrong.
            ServerEvent::Break(true) => ahead.push_back(0),
            // As in many a plug, what the client drives is led back to it.
            ServerEvent::Dtr(on) => self.set_lines(ModemState::DSR | ModemState::CD, *on),
            ServerEvent::Rts(on) => self.set_lines(ModemState::CTS, *on),
            _ => {}
        }
    }

    fn set_lines(&mut self, lines: ModemState, on: bool) {
        let others = self.lines.bits() & !lines.bits();
        let driven = if on { lines.bits() } else { 0 };
        self.lines = ModemState::from_bits(others | driven);
        self.send_lines();
    }

    fn send_lines(&mut self) {
        if let Some(server) = &mut self.server {
            // Where there is no room to tell it, the client does not read, and can ask later.
            let _ = server.try_set_modem_state(self.lines);
        }
    }
}
