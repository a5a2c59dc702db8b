//! Where the objects of a published scene are on a web server.

/// Scheme, host and port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::net) struct Origin {
    /// Whether the connection is over TLS.
    pub(in crate::net) tls: bool,
    /// Host name or IP address, without brackets.
    pub(in crate::net) host: String,
    pub(in crate::net) port: u16,
}

impl Origin {
    /// `HOST:PORT`, without the scheme's own port.
    pub(in crate::net) fn authority(&self) -> String {
        let Self { tls, host, port } = self;
        let host = if host.contains(':') { format!("[{host}]") } else { host.clone() };
        if *port == if *tls { 443 } else { 80 } { host } else { format!("{host}:{port}") }
    }

    /// Parses `HOST` or `HOST:PORT`.
    fn parse(tls: bool, authority: &str) -> Option<Self> {
        let colon = authority.rfind(':').filter(|&at| !authority[at..].contains(']'));
        let (host, port) = match colon {
            Some(at) => (&authority[..at], authority[at + 1..].parse().ok()?),
            None => (authority, if tls { 443 } else { 80 }),
        };
        let host = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
        (!host.is_empty() && !host.contains('@')).then(|| Self { tls, host: host.to_owned(), port })
    }
}

/// An object on a web server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::net) struct Target {
    pub(in crate::net) origin: Origin,
    /// Path and query.
    pub(in crate::net) path: String,
}

impl Target {
    /// An object beside this one, which may have a query that grants access to both.
    pub(super) fn beside(&self, name: &str) -> Self {
        let (path, query) =
            self.path.split_once('?').map_or((&self.path[..], None), |(path, query)| (path, Some(query)));
        let folder = path.rfind('/').map_or("/", |at| &path[..=at]);
        let query = query.map(|query| format!("?{query}")).unwrap_or_default();
        Self { origin: self.origin.clone(), path: format!("{folder}{name}{query}") }
    }

    /// Where a `Location` leads; `None` from https to anything but https, and for other schemes.
    pub(super) fn redirected(&self, location: &str) -> Option<Self> {
        if let Some(path) = location.strip_prefix('/').filter(|path| !path.starts_with('/')) {
            return Some(Self { origin: self.origin.clone(), path: format!("/{path}") });
        }
        let (scheme, rest) = location.split_once("://")?;
        let tls = match scheme.to_ascii_lowercase().as_str() {
            "https" => true,
            "http" if !self.origin.tls => false,
            _ => return None,
        };
        let (authority, path) = rest.find('/').map_or((rest, "/"), |at| rest.split_at(at));
        let path = path.split('#').next().unwrap_or(path).to_owned();
        Some(Self { origin: Origin::parse(tls, authority)?, path })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn target(tls: bool, host: &str, port: u16, path: &str) -> Target {
        Target { origin: Origin { tls, host: host.into(), port }, path: path.into() }
    }

    #[test]
    fn packs_lie_beside_the_scene() {
        let scene = target(true, "h", 443, "/a/b/scene.lss?key=1");
        assert_eq!(scene.beside("packs/x.lsp").path, "/a/b/packs/x.lsp?key=1");
        assert_eq!(target(true, "h", 443, "/scene.lss").beside("packs/x.lsp").path, "/packs/x.lsp");
    }

    #[test]
    fn redirects_keep_tls() {
        let scene = target(true, "h", 443, "/a.lss");
        assert_eq!(scene.redirected("/b/a.lss"), Some(target(true, "h", 443, "/b/a.lss")));
        assert_eq!(scene.redirected("https://[::1]:8443/x#f"), Some(target(true, "::1", 8443, "/x")));
        assert_eq!(scene.redirected("https://i"), Some(target(true, "i", 443, "/")));
        for bad in ["http://h/a", "ftp://h/a", "a.lss", "//h/a", "https://", "https://u@h/a", "https://h:x/"]
        {
            assert_eq!(scene.redirected(bad), None, "{bad}");
        }
        assert!(target(false, "h", 80, "/").redirected("http://i/").is_some());
    }

    #[test]
    fn the_authority_leaves_out_the_schemes_port() {
        assert_eq!(target(true, "h", 443, "/").origin.authority(), "h");
        assert_eq!(target(false, "::1", 8080, "/").origin.authority(), "[::1]:8080");
    }
}
