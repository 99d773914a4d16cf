"""Who must not ask is refused: wrong tokens, hosts, origins, and requests that are none."""

from simulator import HOST, TOKEN, call, raw, request, status

PORT = HOST.rsplit(":", 1)[1]

assert status(request()) == 200

# The token: missing, wrong, too short, too long, in another case, in the query, in another scheme.
for token in [None, "", "x", TOKEN[:-1], TOKEN + "0", TOKEN.swapcase() + "z", "0" * len(TOKEN), "\xff"]:
    assert status(request(token=token)) == 401, token
assert status(request(f"GET /v1/state?token={TOKEN} HTTP/1.1", token=None)) == 401
assert status(request(token=None, more=f"Authorization: Basic {TOKEN}\r\n")) == 401
assert status(request(token=None, more=f"Cookie: token={TOKEN}\r\n")) == 401
for path in ["/v1/steps", "/v1/time", "/v1/names", "/v1/schema", "/v1/events", "/v1/nothing"]:
    assert status(request(f"GET {path} HTTP/1.1", token=None)) == 401, path
assert "WWW-Authenticate: Bearer" in raw(request(token=None))

# Names that merely lead here, as with DNS rebinding, and pages of other sites.
for host in [None, "evil.example", f"evil.example:{PORT}", "127.0.0.1", "127.0.0.1:1", f"localhost.evil.example:{PORT}", f"127.0.0.2:{PORT}"]:
    assert status(request(host=host)) == 403, host
    assert status(request("GET / HTTP/1.1", host=host, token=None)) == 403, host
assert status(request(host=f"localhost:{PORT}")) == 200
for origin in ["http://evil.example", "null", f"https://{HOST}", f"http://{HOST}.evil.example", f"http://localhost:{PORT}"]:
    assert status(request(more=f"Origin: {origin}\r\n")) == 403, origin
assert status(request(more=f"Origin: http://{HOST}\r\n")) == 200
preflight = raw(request("OPTIONS /v1/steps HTTP/1.1", token=None, more="Origin: http://evil.example\r\nAccess-Control-Request-Method: POST\r\n"))
assert " 403 " in preflight and "Access-Control" not in preflight, preflight

# The page is for every client that has the address, and holds no secret.
page = raw(request("GET / HTTP/1.1", token=None))
assert " 200 " in page and "<canvas" in page and TOKEN not in page
assert "default-src 'none'; script-src 'self'" in page and "Access-Control" not in page
assert "frame-ancestors 'none'" in page and "X-Content-Type-Options: nosniff" in page
for path in ["/../../etc/passwd", "/%2e%2e/etc/passwd", "/page.js/", "/v1", "//page.js"]:
    assert status(request(f"GET {path} HTTP/1.1")) == 404, path

# Requests that are too long, torn, or none.
assert status(request("GET /" + "a" * 20000 + " HTTP/1.1")) == 431
assert status(request(more="X: y\r\n" * 100)) == 431
assert status(request(more="Host: again\r\n")) == 400
assert status(b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(300)) == 400
assert status(b"GET / HTTP/9.9\r\n\r\n") == 400
assert status(request("POST /v1/steps HTTP/1.1", more="Content-Length: 70000\r\n")) == 413
assert status(request("POST /v1/steps HTTP/1.1", more="Content-Length: -1\r\n")) == 400
assert status(request("POST /v1/steps HTTP/1.1", more="Content-Length: 1\r\nContent-Length: 2\r\n", body="{}")) == 400
assert status(request("POST /v1/steps HTTP/1.1", more="Transfer-Encoding: chunked\r\n", body="2\r\n{}\r\n0\r\n\r\n")) == 411
for body in ["", "{", "nonsense", "\xff\xfe", "[" * 60000, '{"fault": ' * 5000]:
    data = body.encode("latin-1")
    answer = raw(request("POST /v1/steps HTTP/1.1", more=f"Content-Length: {len(data)}\r\n") + data)
    assert " 400 " in answer.split("\r\n")[0], (body[:20], answer[:300])
assert status(request("PUT /v1/steps HTTP/1.1")) == 405
assert status(request("TRACE /v1/state HTTP/1.1")) == 405
assert status(request("GET /v1/state?x=1 HTTP/1.1")) == 400
# Half a request, and then nothing more: refused, after a while.
assert status(b"GET /v1/state HTTP/1.1\r\nHost: ") == 408

# Many wrong ones later everything is as before.
assert call("GET", "/v1/state")["devices"][0]["report"] == []
