use super::*;

fn guard(address: &str) -> Guard {
    let (address, token) = (address.parse().unwrap(), "secret".into());
    Guard { address, token }
}

fn site(guard: &Guard, host: Option<&str>, origin: Option<&str>) -> bool {
    let head = Head {
        host: host.map(str::to_owned),
        origin: origin.map(str::to_owned),
        ..Head::default()
    };
    guard.check_site(&head).is_ok()
}

#[test]
fn only_the_address_itself_is_a_host() {
    let own = guard("127.0.0.1:4000");
    assert!(site(&own, Some("127.0.0.1:4000"), None));
    assert!(site(&own, Some("localhost:4000"), None));
    for host in [
        "127.0.0.1",
        "127.0.0.1:4001",
        "127.0.0.2:4000",
        "evil.example:4000",
        "localhost.evil.example:4000",
        "127.0.0.1:4000:4000",
        "[::1]:4000",
        "",
        ":4000",
    ] {
        assert!(!site(&own, Some(host), None), "{host}");
    }
    assert!(!site(&own, None, None));
    assert!(site(&guard("[::1]:4000"), Some("[::1]:4000"), None));
    let all = guard("0.0.0.0:4000");
    assert!(site(&all, Some("192.168.1.7:4000"), None));
    assert!(!site(&all, Some("robot.example:4000"), None));
}

#[test]
fn only_our_own_page_is_an_origin() {
    let own = guard("127.0.0.1:4000");
    let host = Some("127.0.0.1:4000");
    assert!(site(&own, host, Some("http://127.0.0.1:4000")));
    for origin in [
        "null",
        "http://127.0.0.1:4001",
        "https://127.0.0.1:4000",
        "http://localhost:4000",
        "http://evil.example",
        "",
    ] {
        assert!(!site(&own, host, Some(origin)), "{origin}");
    }
}

#[test]
fn the_token_has_to_be_right_from_end_to_end() {
    let own = guard("127.0.0.1:4000");
    let given = |text: &str| {
        let head = Head {
            authorization: Some(text.to_owned()),
            ..Head::default()
        };
        own.check_token(&head).map_err(|refusal| refusal.status)
    };
    assert_eq!(given("Bearer secret"), Ok(()));
    for wrong in [
        "",
        "secret",
        "Bearer",
        "Bearer ",
        "Bearer secre",
        "Bearer secrets",
        "bearer secret",
    ] {
        assert_eq!(given(wrong), Err(401), "{wrong}");
    }
    assert_eq!(own.check_token(&Head::default()).unwrap_err().status, 401);
}

#[test]
fn tokens_are_long_and_new_each_time() {
    let tokens = [new_token().unwrap(), new_token().unwrap()];
    assert_ne!(tokens[0], tokens[1]);
    assert!(tokens.iter().all(|token| token.len() == 32));
}

#[test]
fn a_thousand_a_second_after_a_burst() {
    let pace = Pace::default();
    let start = Instant::now();
    let free = (0..1000).filter(|_| pace.turn(start).is_zero()).count();
    assert_eq!(free, 51);
    let later = start + Duration::from_secs(10);
    assert!(pace.turn(later).is_zero());
    assert_eq!(pace.turn(start), Duration::from_millis(9951));
}
