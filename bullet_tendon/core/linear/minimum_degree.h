// An elimination order of a symmetric sparse matrix with little fill-in.
#pragma once
#include <vector>

namespace bt {

// The neighbours of all nodes of a graph, in one array: those of node i are nodes[first[i]] to nodes[first[i
// + 1] - 1].
struct Adjacency {
  std::vector<int> first{0}, nodes;
  int count() const { return static_cast<int>(first.size()) - 1; }
};

// Approximate minimum degree (Amestoy, Davis and Duff 1996). The order is a function of the graph only. The
// arrays are reused from call to call.
class MinimumDegree {
 public:
  // Each edge is listed once at both of its nodes, and no node is its own neighbour. The result is valid
  // until the next call.
  const std::vector<int>& order(const Adjacency& graph);

 private:
  void start(const Adjacency& graph);
  int lightest();
  void make_element(int p);
  void take(int p, int from, int to);
  void measure_elements(int p);
  void update(int p, int i);
  void merge_twins(int p);
  bool twins(int i, int j);
  void join(int i, int into);
  void finish_element(int p);
  void link(int i);
  void unlink(int i);
  void write_order();
  int fresh_stamp() { return ++stamp_; }

  int n_ = 0, left_ = 0, least_ = 0, stamp_ = 0, found_ = 0;
  // Of a variable: its elements, then its variables. Of an element: the variables that it joins.
  std::vector<int> lists_;
  std::vector<int> start_, length_, elements_;  // begin of a list, its length, its number of elements
  std::vector<int> weight_;                     // number of nodes of a variable; 0: eliminated or merged
  std::vector<int> degree_;          // of a variable, an upper bound; of an element, its number of nodes
  std::vector<char> alive_;          // by element: not absorbed yet
  std::vector<int> outside_, seen_;  // |L_e \ L_p|, and the stamp for which it is valid
  std::vector<int> mark_;
  std::vector<int> head_, next_, previous_;  // lists of variables by degree
  std::vector<int> hash_head_, hash_next_, hash_of_;
  std::vector<int> last_, follower_;  // linked list of the nodes of a variable
  std::vector<int> pivots_, order_;
};

}  // namespace bt
