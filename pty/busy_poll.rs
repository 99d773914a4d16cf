//! Looking for news again and again, where it pays, instead of sleeping.

use std::time::Duration;

/// Decision whether the next wait looks busily, and for how long.
///
/// It does if the wait before had news so soon that looking would have found them. So a client that
/// asks as soon as it is answered is not kept waiting while the system wakes this process up, which
/// takes longer than answering; and clients that take their time cost no more than one vain look.
///
/// After a look in vain the next quick wait sleeps, and no more than that one: two processes that
/// wake each other up tend to be put on one processor, and only if one stays awake does the system
/// move the other away.
#[derive(Debug, Default)]
pub(crate) struct BusyPoll {
    longest: Duration,
    pays: bool,
}

impl BusyPoll {
    pub(crate) fn new(longest: Duration) -> Self {
        Self {
            longest,
            pays: false,
        }
    }

    /// Time for which to look before sleeping.
    pub(crate) fn span(&self) -> Duration {
        if self.pays {
            self.longest
        } else {
            Duration::ZERO
        }
    }

    /// Notes a wait: after how long there was news, or that there was none.
    pub(crate) fn note(&mut self, news_after: Option<Duration>) {
        self.pays = news_after.is_some_and(|after| after < self.longest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_pays_after_news_within_the_span_and_no_longer_than_they_keep_coming() {
        let longest = Duration::from_micros(50);
        let quantum = Duration::from_nanos(1);
        let mut busy = BusyPoll::new(longest);
        assert_eq!(busy.span(), Duration::ZERO, "nothing is known yet");
        for (news_after, span) in [
            (Some(longest - quantum), longest),
            (Some(longest), Duration::ZERO),
            (Some(Duration::ZERO), longest),
            (None, Duration::ZERO),
        ] {
            busy.note(news_after);
            assert_eq!(busy.span(), span, "after {news_after:?}");
        }
    }

    #[test]
    fn by_default_it_never_pays() {
        let mut busy = BusyPoll::default();
        busy.note(Some(Duration::ZERO));
        assert_eq!(busy.span(), Duration::ZERO);
    }
}
