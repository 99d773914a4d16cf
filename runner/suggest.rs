//! What a misspelt or former word may have meant.

use rigsim_settings::{Wrong, shorten};

pub(crate) use rigsim_settings::or_allowed;

use crate::renamed::{self, Kind};

/// An error of a form, which names the new key in the place of a former one.
pub(crate) fn in_words(wrong: &Wrong) -> String {
    if let Wrong::UnknownKey(key, allowed) = wrong
        && let Some(renamed) = renamed::find(|kind| matches!(kind, Kind::Key(_)), key)
        && allowed.contains(&renamed.new)
    {
        return renamed.to_string();
    }
    shorten(wrong.to_string().replace('\n', " "))
}
