/** Login with a token, once for each browser, if the console authenticates operators. */

import { fetchJson, operator } from "../model/connection.js";
import { html, setText } from "../dom.js";

/** Return the dictionary once the server accepts requests of this browser; null if it does not answer. */
export async function login() {
  try {
    return await fetchJson("/api/dictionary");
  } catch (error) {
    if (error.status !== 401) return null;
    await requestToken();
    return login();
  }
}

function requestToken() {
  return new Promise((done) => {
    const token = html("input", { type: "password", "aria-label": "token", autocomplete: "current-password" });
    const problem = html("p", { className: "problem", role: "alert" });
    const form = html(
      "form",
      { className: "rover-view login-view", onsubmit: (event) => (event.preventDefault(), submit()) },
      html("h1", { textContent: "Rover console" }),
      html("label", {}, "Your token, from the administrator of rover-console", token),
      html("button", { type: "submit", textContent: "Log in" }),
      problem,
    );

    async function submit() {
      try {
        const answer = await fetchJson("/api/login", { json: { token: token.value.trim() } });
        operator.name = answer.operator;
        form.remove();
        done(undefined);
      } catch (error) {
        setText(problem, error.message);
      }
    }

    document.body.prepend(form);
    token.focus();
  });
}
