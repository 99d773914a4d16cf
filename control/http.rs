//! Requests as they come, from bytes that may be anything.

use form_urlencoded::parse;

use crate::Refusal;

/// Most bytes of a head.
pub const MOST_HEAD: usize = 16 << 10;
/// Most fields of a head.
const MOST_FIELDS: usize = 64;
/// Most bytes of a body.
pub const MOST_BODY: usize = 64 << 10;
/// Most parts of a path, and most parameters behind it.
const MOST_PARTS: usize = 64;

/// The head of a request, as far as it matters.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Head {
    /// As in `GET`.
    pub method: String,
    /// The parts of the path, without what is escaped in them.
    pub path: Vec<String>,
    /// The parameters behind the path.
    pub query: Vec<(String, String)>,
    /// Its `Host`.
    pub host: Option<String>,
    /// Its `Origin`.
    pub origin: Option<String>,
    /// Its `Authorization`.
    pub authorization: Option<String>,
    /// Bytes of the body that follows.
    pub body: usize,
    /// Set if another request may come.
    pub stays: bool,
    /// Set if the client waits until it may send the body.
    pub waits: bool,
}

/// Reads the head of a request; returns it with its length, or `None` while it is not complete.
///
/// # Errors
/// A refusal for the client, whose connection is of no use any more.
pub fn head(bytes: &[u8]) -> Result<Option<(Head, usize)>, Refusal> {
    let mut fields = [httparse::EMPTY_HEADER; MOST_FIELDS];
    let mut request = httparse::Request::new(&mut fields);
    let length = match request.parse(bytes) {
        Ok(httparse::Status::Complete(length)) if length <= MOST_HEAD => length,
        Ok(httparse::Status::Partial) if bytes.len() < MOST_HEAD => return Ok(None),
        Ok(_) | Err(httparse::Error::TooManyHeaders) => {
            return Err(Refusal::new(431, "the head of the request is too long"));
        }
        Err(error) => return Err(Refusal::new(400, format!("no HTTP request: {error}"))),
    };
    let mut head = Head {
        method: request.method.unwrap_or_default().to_owned(),
        stays: request.version == Some(1),
        ..Head::default()
    };
    read_target(&mut head, request.path.unwrap_or_default())?;
    let mut lengths = 0;
    for field in request.headers.iter() {
        lengths += read_field(&mut head, field)?;
    }
    if lengths > 1 {
        return Err(Refusal::new(400, "several lengths"));
    }
    if head.body > MOST_BODY {
        let why = format!("the body is too long; {MOST_BODY} bytes at most");
        return Err(Refusal::new(413, why));
    }
    Ok(Some((head, length)))
}

fn read_target(head: &mut Head, target: &str) -> Result<(), Refusal> {
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let parts = path
        .strip_prefix('/')
        .ok_or_else(|| Refusal::new(400, "the path has to begin with /"))?;
    let too_many = || Refusal::new(414, "too many parts in the path or behind it");
    if parts.split('/').count() > MOST_PARTS || query.split('&').count() > MOST_PARTS {
        return Err(too_many());
    }
    // As in a query, where only `+` means something else.
    let unescaped = |part: &str| {
        let kept = part
            .replace('+', "%2B")
            .replace('&', "%26")
            .replace('=', "%3D");
        parse(kept.as_bytes())
            .next()
            .map(|(name, _)| name.into_owned())
    };
    head.path = parts
        .split('/')
        .map(|part| unescaped(part).unwrap_or_default())
        .collect();
    head.query = parse(query.as_bytes()).into_owned().collect();
    Ok(())
}

/// Reads a field; returns how many lengths it contains.
fn read_field(head: &mut Head, field: &httparse::Header<'_>) -> Result<usize, Refusal> {
    let is = |name: &str| field.name.eq_ignore_ascii_case(name);
    let text = || {
        str::from_utf8(field.value)
            .map(|text| text.trim().to_owned())
            .map_err(|_| Refusal::new(400, format!("{} is not text", field.name)))
    };
    let once = |place: &mut Option<String>| match place.replace(text()?) {
        None => Ok(()),
        Some(_) => Err(Refusal::new(400, format!("two of {}", field.name))),
    };
    if is("host") {
        once(&mut head.host)?;
    } else if is("origin") {
        once(&mut head.origin)?;
    } else if is("authorization") {
        once(&mut head.authorization)?;
    } else if is("content-length") {
        let text = text()?;
        let digits = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
        if !digits {
            return Err(Refusal::new(400, "the length of the body is not a number"));
        }
        // What does not fit in a usize is too long in any case.
        head.body = text.parse().unwrap_or(usize::MAX);
        return Ok(1);
    } else if is("transfer-encoding") {
        let why = "a body has to have a Content-Length and no Transfer-Encoding";
        return Err(Refusal::new(411, why));
    } else if is("expect") {
        head.waits = text()?.eq_ignore_ascii_case("100-continue");
    } else if is("connection") {
        let text = text()?;
        let mut words = text.split(',').map(str::trim);
        if words.any(|word| word.eq_ignore_ascii_case("close")) {
            head.stays = false;
        }
    }
    Ok(0)
}

/// The words for a status.
pub(crate) fn reason(status: u16) -> &'static str {
    match status {
        200 => "OK",
        201 => "Created",
        400 => "Bad Request",
        401 => "Unauthorized",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        408 => "Request Timeout",
        409 => "Conflict",
        411 => "Length Required",
        413 => "Content Too Large",
        414 => "URI Too Long",
        422 => "Unprocessable Content",
        431 => "Request Header Fields Too Large",
        503 => "Service Unavailable",
        _ => "Error",
    }
}

#[cfg(test)]
mod tests;
