use std::net::{IpAddr, SocketAddr};

use http::Request;
use http::header::{HOST, ORIGIN};
use http::uri::Authority;
use rand::TryRngCore;
use rand::rngs::OsRng;

pub(super) const TOKEN: &str = "x-infonerf-token";
/// Header in which a browser names the source of a request (Fetch Metadata).
const SITE: &str = "sec-fetch-site";

/// Guard against requests that other pages make a browser send.
pub(super) struct Guard {
    address: SocketAddr,
    /// Token that the page sends with commands. Other sites cannot read the page, so they cannot know it.
    pub(super) token: String,
}

impl Guard {
    /// Makes a guard for a server on `address`, with a token of 128 random bits.
    pub(super) fn new(address: SocketAddr) -> anyhow::Result<Self> {
        let mut bits = [0; 16];
        OsRng.try_fill_bytes(&mut bits)?;
        Ok(Self { address, token: format!("{:032x}", u128::from_ne_bytes(bits)) })
    }

    pub(super) fn has_token(&self, request: &Request<()>) -> bool {
        request.headers().get(TOKEN).is_some_and(|token| token.as_bytes() == self.token.as_bytes())
    }

    /// Returns the reason why a request is refused, if it is. `linked` requests may come from a link on another site.
    ///
    /// The host must be this server's: a site that points its own name at this machine (DNS rebinding) is another host.
    /// An origin, which browsers send with requests of a page's script, must be this server's as well.
    pub(super) fn refusal(&self, request: &Request<()>, linked: bool) -> Option<String> {
        let named = |name| request.headers().get_all(name).iter().map(|value| value.to_str().unwrap_or_default());
        let hosts: Vec<&str> = named(HOST).chain(request.uri().authority().map(Authority::as_str)).collect();
        if hosts.is_empty() || !hosts.iter().all(|host| self.is_own(host)) {
            let (address, port, found) = (self.address, self.address.port(), hosts.join(", "));
            return Some(format!("host: expected {address} or localhost:{port}, found {found}"));
        }
        let is_same = |origin: &str| origin.strip_prefix("http://").is_some_and(|origin| hosts.contains(&origin));
        if !named(ORIGIN).all(is_same) {
            return Some("origin: expected this server's own page".into());
        }
        let mut sites = named(http::HeaderName::from_static(SITE));
        let elsewhere = sites.any(|site| !["same-origin", "none"].contains(&site));
        (elsewhere && !linked).then(|| format!("{SITE}: expected same-origin"))
    }

    /// Returns whether `host:port` names this server: localhost, a loopback address or the address that it listens on (any
    /// address if that is `0.0.0.0` or `[::]`), with its port.
    fn is_own(&self, host: &str) -> bool {
        let Ok(authority) = host.parse::<Authority>() else { return false };
        let name = authority.host();
        let own = match name.trim_matches(['[', ']']).parse::<IpAddr>() {
            Ok(ip) => ip.is_loopback() || ip == self.address.ip() || self.address.ip().is_unspecified(),
            Err(_) => name.eq_ignore_ascii_case("localhost"),
        };
        own && authority.port_u16().unwrap_or(80) == self.address.port()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn guard_knows_the_names_of_the_server() {
        let is_own = |address: &str, host: &str| Guard::new(address.parse().unwrap()).unwrap().is_own(host);
        for host in ["localhost:7007", "LOCALHOST:7007", "127.0.0.1:7007", "127.8.8.8:7007", "[::1]:7007"] {
            assert!(is_own("127.0.0.1:7007", host) && is_own("192.168.0.1:7007", host), "{host}");
        }
        let others = " :7007 evil.example:7007 localhost.evil.example:7007 192.168.0.1:7007 0.0.0.0:7007 localhost \
                      127.0.0.1:7008 localhost:7007:7007";
        for host in others.split(' ') {
            assert!(!is_own("127.0.0.1:7007", host), "{host}");
        }
        assert!(is_own("192.168.0.1:7007", "192.168.0.1:7007") && is_own("0.0.0.0:7007", "192.168.0.1:7007"));
        assert!(is_own("127.0.0.1:80", "localhost") && !is_own("0.0.0.0:7007", "evil.example:7007"));
    }

    #[test]
    fn tokens_are_drawn_anew() {
        let [a, b] = [0, 1].map(|_| Guard::new("127.0.0.1:7007".parse().unwrap()).unwrap());
        assert!(a.token != b.token && a.token.len() == 32);
    }
}
