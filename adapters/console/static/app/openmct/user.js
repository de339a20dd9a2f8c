/** The operator as the user of Open MCT, which writes the name to displays and notebook entries. */

import { operator } from "../model/connection.js";

export function user() {
  return (openmct) => {
    openmct.user.setProvider({
      on: () => {},
      off: () => {},
      isLoggedIn: () => true,
      getCurrentUser: async () => new openmct.user.User(operator.name, operator.name),
      getPossibleRoles: async () => [],
      hasRole: async () => false,
    });
  };
}
