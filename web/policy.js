// The content security policy, set before anything else runs. It is a script and not a plain tag for one reason: `?url=`
// names an origin to read from, and a policy can only be tightened afterwards, never widened.
(() => {
  let origin = "";
  try {
    const url = new URLSearchParams(location.search).get("url");
    if (url) origin = new URL(url, location.href).origin;
  } catch { /* a bad address is reported where it is opened */ }
  const policy = document.createElement("meta");
  policy.httpEquiv = "Content-Security-Policy";
  policy.content = [
    "default-src 'none'",
    "script-src 'self' 'wasm-unsafe-eval'",
    "style-src 'self'",
    "img-src 'self' blob:",
    `connect-src 'self' ${origin}`,
    "worker-src 'self' blob:",
    "manifest-src 'self'",
    "base-uri 'none'",
    "form-action 'none'",
  ].join("; ");
  document.head.append(policy);
})();
