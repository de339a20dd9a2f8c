// Ranks the results of a search: headings that contain the query first, then headings and texts with
// its terms, then names of the Python API.
var Scorer = {
  objNameMatch: 4,
  objPartialMatch: 2,
  objPrio: { 0: 3, 1: 0, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
  heading: 40,

  score(result) {
    const [page, title, anchor, , score] = result;
    const typed = new URLSearchParams(location.search).get("q").trim().toLowerCase();
    const { alltitles, docnames } = Search._index;
    for (const [heading, sections] of Object.entries(alltitles)) {
      if (!heading.toLowerCase().includes(typed)) continue;
      for (const [number, section] of sections) {
        if (docnames[number] !== page || (anchor && anchor !== `#${section}`)) continue;
        if (!anchor && section) [result[1], result[2]] = [`${title} > ${heading}`, `#${section}`];
        return score + (Scorer.heading * typed.length) / heading.length;
      }
    }
    return score;
  },
};
