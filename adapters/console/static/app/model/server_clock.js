/** The clock of rover-console; the browser's clock may be wrong. */
export const serverClock = {
  /** server's clock minus this browser's clock, s */
  offset_s: 0,

  /** seconds since 1970-01-01 UTC */
  get now_s() {
    return Date.now() / 1000 + this.offset_s;
  },
};
