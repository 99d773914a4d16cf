//! A digest of bytes, the same on every machine.

use std::hash::Hasher as _;

use siphasher::sip::SipHasher13;

pub(crate) fn digest(bytes: &[u8]) -> u64 {
    let mut hasher = SipHasher13::new();
    hasher.write(bytes);
    hasher.finish()
}
