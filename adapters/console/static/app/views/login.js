/** Where the console wants to know who somebody is: asks for a token, once for each browser. */

import { ask, operator } from "../model/connection.js";
import { html, say } from "../dom.js";

/** Return when this browser may ask the server. */
export async function login() {
  try {
    await ask("/api/dictionary");
  } catch (error) {
    if (error.status === 401) await askForToken();
  }
}

function askForToken() {
  return new Promise((done) => {
    const token = html("input", { type: "password", "aria-label": "token", autocomplete: "current-password" });
    const problem = html("p", { className: "problem", role: "alert" });
    const form = html(
      "form",
      { className: "rover-view login-view", onsubmit: (event) => (event.preventDefault(), submit()) },
      html("h1", { textContent: "Rover console" }),
      html("label", {}, "Your token, from whoever runs rover-console", token),
      html("button", { type: "submit", textContent: "Log in" }),
      problem,
    );

    async function submit() {
      try {
        const answer = await ask("/api/login", { json: { token: token.value.trim() } });
        operator.name = answer.operator;
        form.remove();
        done(undefined);
      } catch (error) {
        say(problem, error.message);
      }
    }

    document.body.prepend(form);
    token.focus();
  });
}
