//! What every page has around its content: a self-contained HTML document with one style.

use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;max-width:1100px;margin:2em auto;\
padding:0 1em;color:#222}h1{font-size:1.5em}h2{font-size:1.15em;margin-top:2em}\
table{border-collapse:collapse}td,th{padding:.2em .8em .2em 0;text-align:left;vertical-align:top}\
figure{display:inline-block;margin:.4em .8em .4em 0;vertical-align:top}figcaption{font-size:.85em}\
img{image-rendering:pixelated;background:#202226}svg{fill:#35618f;background:#f4f5f7}\
svg text{fill:#444;font-size:11px}polyline{fill:none;stroke:#35618f;stroke-width:1.5}\
.dot{display:inline-block;width:.8em;height:.8em;margin-right:.4em}\
.over{position:relative;display:inline-block}.over svg{position:absolute;left:0;top:0;background:none;fill:none}";

/// A document under the title "turnlight: …".
pub(super) fn document(title: &str, content: &Markup) -> String {
    let document = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                title { "turnlight: " (title) }
                style { (PreEscaped(STYLE)) }
            }
            body { (content) }
        }
    };
    document.into_string()
}
