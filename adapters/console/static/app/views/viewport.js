/** The visible part of the ground, in px of the picture; x is to the right and y is up. */

const MIN_PX_PER_M = 2;
const MAX_PX_PER_M = 400;
const INITIAL_PX_PER_M = 45;

export class Viewport {
  #picture;
  /** @type {{width: number, height: number} | null} null until measured; to read it makes the browser lay out */
  #size = null;
  /** centre, m */
  x = 0;
  y = 0;
  /** px per m */
  scale = INITIAL_PX_PER_M;

  /** @param {Element} picture */
  constructor(picture) {
    this.#picture = picture;
    new ResizeObserver(() => (this.#size = null)).observe(picture);
  }

  get size() {
    this.#size ??= { width: this.#picture.clientWidth || 400, height: this.#picture.clientHeight || 300 };
    return this.#size;
  }

  /** SVG transform from metres to px. */
  get transform() {
    const { width, height } = this.size;
    const k = this.scale;
    return `matrix(${k} 0 0 ${-k} ${width / 2 - this.x * k} ${height / 2 + this.y * k})`;
  }

  /** @param {number} x_m @param {number} y_m */
  toScreen(x_m, y_m) {
    const { width, height } = this.size;
    return [(x_m - this.x) * this.scale + width / 2, height / 2 - (y_m - this.y) * this.scale];
  }

  /** @param {number} x_px @param {number} y_px */
  toWorld(x_px, y_px) {
    const { width, height } = this.size;
    return [(x_px - width / 2) / this.scale + this.x, (height / 2 - y_px) / this.scale + this.y];
  }

  /** @param {number} x_m @param {number} y_m */
  centreAt(x_m, y_m) {
    this.x = x_m;
    this.y = y_m;
  }

  /** @param {number} factor */
  zoom(factor) {
    this.scale = Math.min(Math.max(this.scale * factor, MIN_PX_PER_M), MAX_PX_PER_M);
  }

  /** Fit points into the view. @param {number[][]} points */
  fit(points) {
    const xs = points.map((each) => each[0]);
    const ys = points.map((each) => each[1]);
    const [west, east, south, north] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    const { width, height } = this.size;
    const scale = Math.min(width / (east - west + 2), height / (north - south + 2));
    this.scale = Math.min(Math.max(scale, MIN_PX_PER_M), INITIAL_PX_PER_M * 2);
    this.centreAt((west + east) / 2, (south + north) / 2);
  }
}
