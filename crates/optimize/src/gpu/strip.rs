//! Shaders without comments and indentation, made by the compiler: a tenth of what a page's visitor would load of them for
//! nothing. WGSL has no strings, so two slashes always begin a comment.

/// Length of [`strip`]'s result.
pub(super) const fn kept(text: &str) -> usize {
    copy(text.as_bytes(), &mut [])
}

/// The text without line comments and without spaces at the start of lines.
pub(super) const fn strip<const N: usize>(text: &str) -> [u8; N] {
    let mut out = [0; N];
    copy(text.as_bytes(), &mut out);
    out
}

/// Writes as far as there is room, and returns how much there is to write.
const fn copy(text: &[u8], out: &mut [u8]) -> usize {
    let (mut from, mut to) = (0, 0);
    let mut at_start = true;
    while from < text.len() {
        if text[from] == b'/' && from + 1 < text.len() && text[from + 1] == b'/' {
            while from < text.len() && text[from] != b'\n' {
                from += 1;
            }
            continue;
        }
        let skipped = at_start && (text[from] == b' ' || text[from] == b'\n');
        at_start = text[from] == b'\n' || skipped;
        if !skipped {
            if to < out.len() {
                out[to] = text[from];
            }
            to += 1;
        }
        from += 1;
    }
    to
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_and_indentation_go_and_nothing_else() {
        const TEXT: &str = "// why\n#import \"a/b.wgsl\"\n\nfn f() -> f32 { // what\n    return 1.0 / 2.0;\n}\n";
        const BYTES: [u8; kept(TEXT)] = strip(TEXT);
        assert_eq!(str::from_utf8(&BYTES), Ok("#import \"a/b.wgsl\"\nfn f() -> f32 { \nreturn 1.0 / 2.0;\n}\n"));
    }

    #[test]
    fn no_shader_has_a_comment_that_would_stay() {
        for (path, text) in super::super::compose::SOURCES {
            assert!(!text.contains("/*"), "{path}");
        }
    }
}
