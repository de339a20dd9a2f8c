/** The sound of a new alarm, if the operator has turned it on in this browser. */

import { button, set, setText } from "./dom.js";

const CHOICE = "rover-console-sound";
const TONE_HZ = 880;
const TONE_S = 0.4;
/** @type {AudioContext | null} created at the first tone: a browser permits sound after a click only */
let audio = null;

const isOn = () => localStorage.getItem(CHOICE) === "on";

/** Sound a tone, if the sound is on. */
export function beep() {
  if (!isOn()) return;
  audio ??= new AudioContext();
  audio.resume();
  const tone = audio.createOscillator();
  tone.frequency.value = TONE_HZ;
  tone.connect(audio.destination);
  tone.start();
  tone.stop(audio.currentTime + TONE_S);
}

/** Return the button that turns the sound on and off. */
export function soundButton() {
  const made = button("", "a tone at each new alarm, in this browser; after a reload it needs a click anywhere in the page", toggle);
  function label() {
    setText(made, isOn() ? "sound on" : "sound off");
    set(made, { "aria-pressed": isOn(), class: isOn() ? "on" : "" });
  }
  function toggle() {
    localStorage.setItem(CHOICE, isOn() ? "off" : "on");
    label();
    beep();
  }
  label();
  return made;
}
